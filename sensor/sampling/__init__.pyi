from . import poisson, streams
from .poisson import draw_poisson
from .streams import generator, pixel_normals, pixel_uniforms

__all__ = [
    "draw_poisson",
    "generator",
    "pixel_normals",
    "pixel_uniforms",
    "poisson",
    "streams",
]
