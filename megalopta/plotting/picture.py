"""A figure with its caption and numbers, and its files: two of the picture, two of the numbers."""

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

from megalopta.core.files import atomic_write, write_csv, write_json
from megalopta.plotting.style import house_style, new_canvas

Cell: TypeAlias = float | str


@dataclass(frozen=True)
class Figure:
    """One reproduced figure or table."""

    title: str
    """Title, in one line; figures of the dissertation begin with their number: "Figure 3.2: …"."""
    caption: str
    """Content and method, in at most three sentences."""
    draw: Callable[[Canvas], None]
    """Draws axes on an empty matplotlib figure of the house style."""
    numbers: Mapping[str, Sequence[Cell] | NDArray[np.floating | np.integer]]
    """Numbers behind the picture: columns of equal length by name and unit, as in "time_s"; NaN if
    missing."""
    height_in: float = 4.0
    """Height of the drawing (inches), without title, table and caption; it is 7 inches wide."""
    printed: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """Our number and the dissertation's, with units, by quantity: a small table under the drawing.
    """
    printed_by: tuple[str, str] = ("Ours", "Dissertation")
    """Column heads of that table."""
    details: Mapping[str, Any] = field(default_factory=dict)
    """Further results, ready for JSON: parameters, intervals, error curves."""
    name: str = ""
    """Name of its recipe, on the command line and in file names: "fig-3.2", "table-3.1"."""

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
        """Numbers, row by row."""
        plain = (
            each.tolist() if isinstance(each, np.ndarray) else each
            for each in self.numbers.values()
        )
        return tuple(zip(*plain, strict=True))


def columns_of(rows: Iterable[Mapping[str, Cell]]) -> dict[str, list[Cell]]:
    """Return the columns of one or more rows with the same names."""
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
        canvas.set_layout_engine("none")  # one layout for both pictures
        for axes in canvas.axes:  # the solver's last bits differ between runs
            axes.set_position(np.round(axes.get_position(original=True).bounds, 9).tolist())
        title = {"Title": figure.title}
        # `savefig` would draw each twice for its layout
        pixels: Any = FigureCanvasAgg(canvas)
        with atomic_write(png) as temporary:
            pixels.print_png(temporary, metadata=title, pil_kwargs={"compress_level": 3})
        lines: Any = FigureCanvasSVG(canvas)
        with atomic_write(svg) as temporary:
            lines.print_svg(temporary, metadata={**title, "Date": None})
    # nine digits: more would show one machine's rounding
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
        "rows": [
            [each if isinstance(each, str) or math.isfinite(each) else None for each in row]
            for row in figure.rows
        ],
        **figure.details,
    }
