"""A figure of the dissertation, made again from the models: its picture, caption and numbers."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray

Cell: TypeAlias = float | str
Floats: TypeAlias = NDArray[np.float64]


class Printed(NamedTuple):
    """One number of ours beside what the dissertation prints, with units."""

    quantity: str
    ours: str
    dissertation: str


@dataclass(frozen=True)
class Figure:
    """One reproduced figure or table.

    Attributes
    ----------
    name : str
        As on the command line and in file names: "fig-3.2", "table-3.1".
    title : str
        What is shown, in one line; of the dissertation's figures with their number: "Figure 3.2:
        …".
    caption : str
        What is drawn and how it was made, in at most three sentences.
    draw : function
        Adds axes to an empty matplotlib figure of the house style and draws on them.
    columns : tuple of str
        Names of the columns of the numbers behind the picture, with unit: "time_s", "output_v".
    rows : tuple of tuples
        One value per column; NaN where there is none.
    height_in : float
        Height of the drawing, without title, table and caption (inches); it is 7 inches wide.
    printed : tuple of Printed
        Our numbers beside those of the dissertation, a small table under the drawing.
    findings : tuple of str
        Sentences that the numbers of this run bear out.
    details : mapping, optional
        What else belongs to the numbers, ready for JSON: parameters, intervals, error curves.
    """

    name: str
    title: str
    caption: str
    draw: Callable[[Canvas], None]
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    height_in: float = 4.0
    printed: tuple[Printed, ...] = ()
    findings: tuple[str, ...] = ()
    details: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse a table with ragged rows."""
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"{self.name}: row {row} does not fit columns {self.columns}")


def rows_of(*columns: Iterable[float]) -> tuple[tuple[float, ...], ...]:
    """Rows of a figure's numbers from its columns."""
    return tuple(tuple(map(float, row)) for row in zip(*columns, strict=True))
