"""Shapes and textures from a seed, as trimesh meshes and numpy arrays."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
