"""A figure of the dissertation, made again from the models: its picture, caption and numbers."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray

Cell: TypeAlias = float | str


@dataclass(frozen=True)
class Figure:
    """One reproduced figure or table.

    Attributes
    ----------
    title : str
        What is shown, in one line; of the dissertation's with their number: "Figure 3.2: …".
    caption : str
        What is drawn and how it was made, in at most three sentences.
    draw : function
        Adds axes to an empty matplotlib figure of the house style and draws on them.
    numbers : mapping
        Those behind the picture: equally long columns by name and unit, as in "time_s"; NaN where
        there is none.
    height_in : float
        Height of the drawing, without title, table and caption (inches); it is 7 inches wide.
    printed : mapping
        Our number and that which the dissertation prints, with units, by what they are: a small
        table under the drawing.
    printed_by : (str, str)
        Heads of that table's columns, where they are others.
    findings : tuple of str
        Sentences that the numbers of this run bear out.
    details : mapping
        What else belongs to the numbers, ready for JSON: parameters, intervals, error curves.
    name : str
        That of its recipe, as on the command line and in file names: "fig-3.2", "table-3.1".
    """

    title: str
    caption: str
    draw: Callable[[Canvas], None]
    numbers: Mapping[str, Sequence[Cell] | NDArray[np.floating | np.integer]]
    height_in: float = 4.0
    printed: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    printed_by: tuple[str, str] = ("Ours", "Dissertation")
    findings: tuple[str, ...] = ()
    details: Mapping[str, Any] = field(default_factory=dict)
    name: str = ""

    def __post_init__(self) -> None:
        """Refuse columns of unequal length."""
        if len({len(column) for column in self.numbers.values()}) > 1:
            raise ValueError(f"{self.title}: columns {self.columns} differ in length")

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of numbers."""
        return tuple(self.numbers)

    @property
    def rows(self) -> tuple[tuple[Cell, ...], ...]:
        """The numbers, row by row."""
        plain = (
            each.tolist() if isinstance(each, np.ndarray) else each
            for each in self.numbers.values()
        )
        return tuple(zip(*plain, strict=True))


def columns_of(rows: Iterable[Mapping[str, Cell]]) -> dict[str, list[Cell]]:
    """Return the columns of one row or more, all of the same names."""
    first, *others = rows
    return {name: [value, *(row[name] for row in others)] for name, value in first.items()}


def borne_out(*sentences: str | None) -> tuple[str, ...]:
    """Return the findings among sentences that are None where the numbers say otherwise."""
    return tuple(sentence for sentence in sentences if sentence)
