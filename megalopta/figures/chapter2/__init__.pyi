from .counter import COUNTER
from .devices import CHAPTER_2
from .edge import MOTION
from .transfer import TRANSFER

__all__ = [
    "CHAPTER_2",
    "COUNTER",
    "MOTION",
    "TRANSFER",
]
