from .film import Film
from .primary import pixel_means

__all__ = [
    "Film",
    "pixel_means",
]
