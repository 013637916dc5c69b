"""House style of all figures: one type size, colors for color-blind readers.

The colors are those of Okabe and Ito (2008). Curves should also differ in marker or dash, for
readers in gray. Figures stay readable at half their width. Only matplotlib's object interface is
used: no window, no state shared between figures.
"""

import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal
from zlib import crc32

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import EngFormatter, NullFormatter
from matplotlib.typing import LineStyleType

from megalopta.core.arrays import Floats
from megalopta.flow.detectors.registry import METHODS, THESIS_METHODS

WIDTH_IN = 7.0

BLUE = "#0072B2"
ORANGE = "#E69F00"
GREEN = "#009E73"
VERMILION = "#D55E00"
PURPLE = "#CC79A7"
SKY = "#56B4E9"
BLACK = "#1A1A1A"
GRAY = "#7F7F7F"
RULE = "#E3E3E3"
PALETTE = (BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY, BLACK)
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
GLYPHS = dict(zip(MARKERS, "●■▲◆▼✚✖", strict=True))
"""Markers as characters in text"""

DASHES: tuple[LineStyleType, ...] = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)))

_STYLE = matplotlib.rc_params_from_file(
    Path(__file__).with_name("house.mplstyle"), use_default_template=False
)
_CAPTION_SIZE = 9.0
_LINE_IN = 0.168
_CHARACTERS = 100
_TITLE_SIZE = 13
_TITLE_LINE_IN = 0.24
_TITLE_CHARACTERS = 62
_MARGIN_IN = 0.12
_TABLE_COLUMNS_IN = (_MARGIN_IN, 3.3, 5.1)


def method_style(name: str) -> dict[str, Any]:
    """Return color, marker and dash of a method: solid for the dissertation's, dashed for others.

    Known methods differ in color, marker or dash, and look the same in all figures.
    """
    # a Python function is not in the list
    number = list(METHODS).index(name) if name in METHODS else crc32(name.encode())
    lap, place = divmod(number, len(PALETTE))
    return {
        "color": PALETTE[(place + 3 * (lap // 2)) % len(PALETTE)],
        "marker": MARKERS[(place + lap) % len(MARKERS)],
        "linestyle": "-" if name in THESIS_METHODS else "--",
    }


def line_style(place: int) -> dict[str, Any]:
    """Return color and dash of the line at this index."""
    return {"color": PALETTE[place], "linestyle": DASHES[place % len(DASHES)]}


@contextmanager
def house_style(changes: Mapping[Any, Any] = MappingProxyType({})) -> Iterator[None]:
    """Apply matplotlib settings of the house style, with changes, inside the block."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_STYLE)
        matplotlib.rcParams.update(changes)
        yield


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
    canvas = Canvas(figsize=(WIDTH_IN, total), dpi=_STYLE["savefig.dpi"])
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


def write_at(
    axes: Axes, text: str, at: tuple[float, float], offset: tuple[float, float], **style: Any
) -> None:
    """Write text at an offset in points from a place, in data coordinates unless stated."""
    axes.annotate(text, at, offset, textcoords="offset points", **style)


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


def wrapped(text: str, characters: int) -> list[str]:
    """Wrap text into lines; a number stays with its unit."""
    held = re.sub(r"(?<=[\d×=]) (?=\S)| (?=[×=%])", "\N{NO-BREAK SPACE}", text)
    return textwrap.wrap(held, characters, break_on_hyphens=False)


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
