from .seeding import generator
from .surface import FloatArray, Surface, cross, join, unit
from .surface_textures import TEXTURES

__all__ = [
    "TEXTURES",
    "FloatArray",
    "Surface",
    "cross",
    "generator",
    "join",
    "unit",
]
