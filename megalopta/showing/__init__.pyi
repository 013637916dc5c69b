from .card import write_card
from .sheet import write_view

__all__ = [
    "write_card",
    "write_view",
]
