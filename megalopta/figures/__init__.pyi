from .figure import Cell, Figure, Floats, Printed, rows_of
from .recipe import FigureRecipe, Run, Templates
from .registry import names
from .reproduction import reproduce, reproduce_sweep
from .style import (
    BLACK,
    BLUE,
    DASHES,
    GRAY,
    GREEN,
    MARKERS,
    ORANGE,
    PALETTE,
    VERMILION,
    draw_table,
    house_style,
    method_style,
    new_canvas,
)
from .sweep import Needed, needed, sweep_curve, sweep_figure, threshold_of

__all__ = [
    "BLACK",
    "BLUE",
    "DASHES",
    "GRAY",
    "GREEN",
    "MARKERS",
    "ORANGE",
    "PALETTE",
    "VERMILION",
    "Cell",
    "Figure",
    "FigureRecipe",
    "Floats",
    "Needed",
    "Printed",
    "Run",
    "Templates",
    "draw_table",
    "house_style",
    "method_style",
    "names",
    "needed",
    "new_canvas",
    "reproduce",
    "reproduce_sweep",
    "rows_of",
    "sweep_curve",
    "sweep_figure",
    "threshold_of",
]
