from .pixel import CTIA_PIXEL
from .suppression import CTIA_SUPPRESSION

__all__ = [
    "CTIA_PIXEL",
    "CTIA_SUPPRESSION",
]
