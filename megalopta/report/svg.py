"""Matplotlib figures as SVG that lives inside a page: its fonts, its colors in light and dark.

Figures are drawn in stand-in colors, which become variables of the page's style sheet.
"""

import io
import re
from collections.abc import Callable
from typing import Any, Literal, ParamSpec, TypeVar

from markupsafe import Markup, escape
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullLocator

_P = ParamSpec("_P")
_R = TypeVar("_R")

INK = "#010101"
RULE = "#020202"
MARKERS = "os^vDX"
_SERIES = tuple(f"#0a000{index}" for index in range(1, 8))
_THEMED = {
    INK: "currentColor",
    RULE: "var(--rule)",
    **{color: f"var(--series-{index})" for index, color in enumerate(_SERIES, 1)},
}

_POINTS_PER_INCH = 72
_STYLE: Any = {
    "svg.fonttype": "none",
    "font.size": 11,
    "axes.labelsize": 11,
    "axes.linewidth": 0.8,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "grid.color": RULE,
    "grid.linewidth": 0.8,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 10.5,
    "ytick.labelsize": 10.5,
    "legend.frameon": False,
    "lines.linewidth": 1.8,
    "lines.markersize": 5,
}


def series_color(index: int) -> str:
    """Stand-in for the color of the index-th series; colors repeat after seven."""
    return _SERIES[index % len(_SERIES)]


def series_css(index: int) -> str:
    """The same color for a style sheet."""
    return _THEMED[series_color(index)]


def marker(index: int) -> str:
    """Matplotlib's marker of the index-th series."""
    return MARKERS[index % len(MARKERS)]


def in_style(draw: Callable[_P, _R]) -> Callable[_P, _R]:
    """Let a function draw in the page's style, lines and markers included."""
    return rc_context(_STYLE)(draw)


def new_axes(width_pt: float, height_pt: float) -> tuple[Figure, Axes]:
    """Return a figure of this size with one pair of axes; for functions that are `in_style`."""
    figure = Figure(
        figsize=(width_pt / _POINTS_PER_INCH, height_pt / _POINTS_PER_INCH), layout="constrained"
    )
    return figure, figure.add_subplot()


def logarithmic(axes: Axes, which: Literal["x", "y"], labels: FuncFormatter) -> None:
    """Make an axis logarithmic, its labels in words, with a faint grid."""
    axes.set(**{f"{which}scale": "log"})
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.set_major_formatter(labels)
    axis.set_minor_locator(NullLocator())
    axes.grid(axis=which)


def to_svg(figure: Figure, name: str, description: str) -> Markup:
    """Return a figure as an SVG element.

    Parameters
    ----------
    figure : Figure
    name : str
        Letters, digits and dashes; makes the element's identifiers unique on the page.
    description : str
        What is to be seen, for those who do not see it.
    """
    file = io.StringIO()
    with rc_context({**_STYLE, "svg.hashsalt": name}):
        figure.savefig(file, format="svg", transparent=True, metadata={"Date": None})
    svg = file.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r"<style.*?</style>|<!--.*?-->", "", svg, flags=re.DOTALL)
    svg = re.sub(r"font-family:[^;]*; ", "", svg)
    view = re.search(r'viewBox="[^"]*"', svg)
    label = escape(description)
    head = f'<svg class="plot" role="img" aria-label="{label}" {view[0] if view else ""}>'
    svg = re.sub(r"<svg[^>]*>", lambda _: head, svg, count=1)
    svg = re.sub(r'(\sid="|url\(#|href="#)', rf"\g<1>{name}-", svg)
    for stand_in, color in _THEMED.items():
        svg = svg.replace(stand_in, color)
    return Markup(svg)
