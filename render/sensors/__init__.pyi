from .panoramic import PANORAMA, register_panorama
from .rows import ROWS, register_rows

__all__ = [
    "PANORAMA",
    "ROWS",
    "register_panorama",
    "register_rows",
]
