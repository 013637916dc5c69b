from .board import add_entries, read_board
from .scores import Entry, Scores, score_submission
from .tables import board_table, score_table

__all__ = [
    "Entry",
    "Scores",
    "add_entries",
    "board_table",
    "read_board",
    "score_submission",
    "score_table",
]
