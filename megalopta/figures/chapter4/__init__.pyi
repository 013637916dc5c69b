from .curves import CHAPTER_4
from .page import TABLE, write_page
from .scenes import CHAPTER_4_SCENES, figure_4_3

__all__ = [
    "CHAPTER_4",
    "CHAPTER_4_SCENES",
    "TABLE",
    "figure_4_3",
    "write_page",
]
