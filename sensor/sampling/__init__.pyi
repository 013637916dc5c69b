from . import poisson, streams
from .poisson import draw_poisson
from .streams import generator, pixel_normals, pixel_uniforms
from .words import LANES, fill_words, word_streams

__all__ = [
    "LANES",
    "draw_poisson",
    "fill_words",
    "generator",
    "pixel_normals",
    "pixel_uniforms",
    "poisson",
    "streams",
    "word_streams",
]
