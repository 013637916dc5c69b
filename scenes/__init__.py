"""Scenes as plain frozen data: objects, lighting, cameras and their paths.

    light, camera, trajectory = Light(level="starlight"), PerspectiveCamera(), Trajectory()
    scene = build_scene(Forest(trees=200), light, camera, trajectory)

World coordinates are right-handed, in meters, with z up. No renderer is needed here.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
