from .seeding import generator
from .surface import FloatArray, Surface, cross, grid_corners, grid_faces, join, unit
from .surface_textures import TEXTURES

__all__ = [
    "TEXTURES",
    "FloatArray",
    "Surface",
    "cross",
    "generator",
    "grid_corners",
    "grid_faces",
    "join",
    "unit",
]
