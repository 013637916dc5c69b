from .film import Film

__all__ = [
    "Film",
]
