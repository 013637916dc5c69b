from .bodies import ball, box, checkerboard
from .dead_leaves_model import dead_leaves
from .grating import (
    GratingVariant,
    Pattern,
    bars,
    board,
    moving_cycles,
    open_cylinder,
    random_dots,
    sine_grating,
)

__all__ = [
    "GratingVariant",
    "Pattern",
    "ball",
    "bars",
    "board",
    "box",
    "checkerboard",
    "dead_leaves",
    "moving_cycles",
    "open_cylinder",
    "random_dots",
    "sine_grating",
]
