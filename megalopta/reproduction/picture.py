"""A figure with its caption and numbers, and its files: two of the picture, two of the numbers."""

import math
import re
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import EngFormatter, NullFormatter
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.core.files import atomic_write, write_csv, write_json
from megalopta.report.style import BLACK, RULE, house_style

Cell: TypeAlias = float | str

WIDTH_IN = 7.0
_CAPTION_SIZE = 9.0
_LINE_IN = 0.168
_CHARACTERS = 100
_TITLE_SIZE = 13
_TITLE_LINE_IN = 0.24
_TITLE_CHARACTERS = 62
_MARGIN_IN = 0.12
_TABLE_COLUMNS_IN = (_MARGIN_IN, 3.3, 5.1)


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


def new_canvas(
    title: str, caption: str, height_in: float, table: Sequence[Sequence[str]] = ()
) -> Canvas:
    """Return an empty matplotlib figure with a title above and a caption below the drawing.

    Title and caption are wrapped to the width. The drawing is `height_in` high; below it is
    `table`, rows of three texts, the first of which is its head.
    """
    head, lines = wrapped(title, _TITLE_CHARACTERS), wrapped(caption, _CHARACTERS)
    above = _TITLE_LINE_IN * len(head) + 0.16
    tabled = _LINE_IN * len(table) + (_MARGIN_IN if table else 0)
    below = tabled + _LINE_IN * len(lines) + 2 * _MARGIN_IN
    total = below + height_in + above
    canvas = Canvas(figsize=(WIDTH_IN, total), dpi=rcParams["savefig.dpi"])
    FigureCanvasAgg(canvas)
    inside = (0.0, below / total, 1.0, height_in / total)
    canvas.set_layout_engine("constrained", rect=inside)

    def write(text: str, left_in: float, top_in: float, **style: Any) -> None:
        place = left_in / WIDTH_IN, 1 - top_in / total
        canvas.text(*place, text, va="top", color=BLACK, **style)

    write("\n".join(head), _MARGIN_IN, _MARGIN_IN, fontsize=_TITLE_SIZE, fontweight="bold")
    top = above + height_in + _MARGIN_IN
    for row, texts in enumerate(table):
        weight = "normal" if row else "bold"
        for text, left in zip(texts, _TABLE_COLUMNS_IN, strict=True):
            place = left, top + row * _LINE_IN
            write(text, *place, fontsize=_CAPTION_SIZE, fontweight=weight)
    write("\n".join(lines), _MARGIN_IN, top + tabled, fontsize=_CAPTION_SIZE, linespacing=1.3)
    return canvas


def log_decades(axes: Axes, which: Literal["x", "y"], labels: str | None = None) -> None:
    """Make an axis logarithmic, with labels at decades only, by default such as 10k."""
    axes.set(**{f"{which}scale": "log"})
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.set_major_formatter(EngFormatter(sep="") if labels is None else labels)
    axis.set_minor_formatter(NullFormatter())


def draw_interval(
    axes: Axes, x: Any, middle: Floats, ends: Sequence[Floats] | Floats, **style: Any
) -> None:
    """Draw a line with whiskers between the lower and upper ends."""
    low, high = ends
    axes.errorbar(x, middle, (middle - low, high - middle), **style)


def draw_table(
    canvas: Canvas, head: Sequence[str], rows: Sequence[Sequence[str]], widths: Sequence[float]
) -> None:
    """Draw a table of text, with a rule under its head and light rules between its rows.

    A column's share of the page is proportional to its width.
    """
    axes = canvas.subplots()
    axes.set_axis_off()
    starts = [sum(widths[:column]) / sum(widths) for column in range(len(widths))]
    lines = len(rows) + 1
    for line, row in enumerate([head, *rows]):
        weight, color, width = ("normal", RULE, 0.8) if line else ("bold", BLACK, 1.2)
        for start, text in zip(starts, row, strict=True):
            height = 1 - (line + 0.5) / lines
            axes.text(start + 0.01, height, text, va="center", fontsize=10.5, fontweight=weight)
        axes.plot([0, 1], [1 - (line + 1) / lines] * 2, color=color, linewidth=width)
    axes.set(xlim=(0, 1), ylim=(0, 1))


def wrapped(text: str, characters: int) -> list[str]:
    """Wrap text into lines; a number stays with its unit."""
    held = re.sub(r"(?<=[\d×=]) (?=\S)| (?=[×=%])", "\N{NO-BREAK SPACE}", text)
    return textwrap.wrap(held, characters, break_on_hyphens=False)
