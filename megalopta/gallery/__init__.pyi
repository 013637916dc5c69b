from .sheet import write_gallery

__all__ = [
    "write_gallery",
]
