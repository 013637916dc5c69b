"""Shapes and textures grown from a seed, as trimesh meshes and numpy arrays."""
