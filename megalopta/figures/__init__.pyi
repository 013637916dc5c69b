from .figure import Cell, Figure, Printed, Registry
from .planned import Planned, PlannedRegistry, Templates
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
    "Needed",
    "Planned",
    "PlannedRegistry",
    "Printed",
    "Registry",
    "Templates",
    "draw_table",
    "house_style",
    "method_style",
    "needed",
    "new_canvas",
    "reproduce",
    "reproduce_sweep",
    "sweep_curve",
    "sweep_figure",
    "threshold_of",
]
