"""A figure: its picture, caption and numbers, and its files: a picture twice, numbers twice."""

import csv
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray

from megalopta.core.files import atomic_write, write_json
from megalopta.plotting.style import house_style, new_canvas

Cell: TypeAlias = float | str


@dataclass(frozen=True)
class Figure:
    """One reproduced figure or table."""

    title: str
    """What is shown, in one line; of the dissertation's with their number: "Figure 3.2: …"."""
    caption: str
    """What is drawn and how it was made, in at most three sentences."""
    draw: Callable[[Canvas], None]
    """Adds axes to an empty matplotlib figure of the house style and draws on them."""
    numbers: Mapping[str, Sequence[Cell] | NDArray[np.floating | np.integer]]
    """Those behind the picture: equally long columns by name and unit, as in "time_s"; NaN where
    there is none."""
    height_in: float = 4.0
    """Height of the drawing, without title, table and caption (inches); it is 7 inches wide."""
    printed: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """Our number and that which the dissertation prints, with units, by what they are: a small
    table under the drawing."""
    printed_by: tuple[str, str] = ("Ours", "Dissertation")
    """Heads of that table's columns, where they are others."""
    details: Mapping[str, Any] = field(default_factory=dict)
    """What else belongs to the numbers, ready for JSON: parameters, intervals, error curves."""
    name: str = ""
    """That of its recipe, as on the command line and in file names: "fig-3.2", "table-3.1"."""

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


def write_figure(figure: Figure, out: Path) -> list[Path]:
    """Draw one figure and write its four files."""
    paths = png, svg, numbers, record = [
        out / f"{figure.name}.{kind}" for kind in ("png", "svg", "csv", "json")
    ]
    table = [(what, *values) for what, values in figure.printed.items()]
    with house_style():
        head = [("", *figure.printed_by)] if table else []
        canvas = new_canvas(figure.title, figure.caption, figure.height_in, head + table)
        figure.draw(canvas)
        if layout := canvas.get_layout_engine():
            layout.execute(canvas)
        canvas.set_layout_engine("none")  # laid out once is enough for both pictures
        title = {"Title": figure.title}
        # `savefig` would draw each twice, to see where things lie
        pixels: Any = FigureCanvasAgg(canvas)
        with atomic_write(png) as temporary:
            pixels.print_png(temporary, metadata=title, pil_kwargs={"compress_level": 3})
        lines: Any = FigureCanvasSVG(canvas)
        with atomic_write(svg) as temporary:
            lines.print_svg(temporary, metadata={**title, "Date": None})
    # nine digits: more would show the rounding of one machine's arithmetic
    write_csv(numbers, figure.columns, figure.rows, digits=9)
    write_json(record, _record(figure))
    return paths


def _record(figure: Figure) -> dict[str, Any]:
    heads = [head.lower() for head in figure.printed_by]
    return {
        "name": figure.name,
        "title": figure.title,
        "caption": figure.caption,
        "printed": [
            {"quantity": what, **dict(zip(heads, values, strict=True))}
            for what, values in figure.printed.items()
        ],
        "columns": figure.columns,
        "rows": [[_json(value) for value in row] for row in figure.rows],
        **figure.details,
    }


def _json(value: Cell) -> Cell | None:
    return value if isinstance(value, str) or math.isfinite(value) else None


def write_csv(
    path: Path, head: Iterable[str], rows: Iterable[Iterable[Any]], digits: int = 6
) -> None:
    """Write a table; numbers have so many digits."""
    with atomic_write(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        lines = csv.writer(file, lineterminator="\n")
        lines.writerow(head)
        for row in rows:
            lines.writerow(
                f"{each:.{digits}g}" if isinstance(each, int | float) else each for each in row
            )
