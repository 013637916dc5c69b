"""Matplotlib figures as SVG inside a page: its fonts, its colors in light and dark.

Figures are drawn in the house style; its black and grid become colors of the page's style sheet.
"""

import io
import re
from typing import Any, Literal

import numpy as np
from markupsafe import Markup
from matplotlib import colormaps, rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullLocator, ScalarFormatter

from megalopta.core.arrays import Floats
from megalopta.plotting.style import BLACK, GRAY, RULE, house_style
from megalopta.plotting.text import short

_THEMED = {BLACK: "currentColor", RULE: "var(--rule)"}
_POINTS_PER_INCH = 72
CHART_PT = 380, 270
"""Width and height (pt); also the width of a page on a telephone, so that text keeps its size"""
_WIDEST_PT = 460
"""Wider figures scroll on a telephone, where their text would be too small"""
_LEAST_PX_PER_PT = 0.75
_MAP, _BAR = (0.1, 0.13, 0.68, 0.78), (0.8, 0.17, 0.025, 0.7)
"""Left, bottom, width and height in the picture; constants are faster than a layout."""

NUMBERS = FuncFormatter(lambda value, _: short(value))
"""Labels of a logarithmic axis"""

in_style = house_style({"svg.fonttype": "none", "axes.grid": False})
"""Decorator: draw in the page's style, lines and markers included."""


def themed(color: str) -> str:
    """Return a style-sheet color for a color of the house style."""
    return _THEMED.get(color, color)


def drawable(values: Floats) -> Floats:
    """Return the values that a logarithmic axis can show, with gaps elsewhere."""
    return np.where(values > 0, values, np.nan)


def verbatim(text: str) -> str:
    """Escape text for matplotlib, dollar signs included."""
    return text.replace("$", r"\$")


def new_axes(width_pt: float, height_pt: float) -> tuple[Figure, Axes]:
    """Return a figure of this size with one pair of axes; for `in_style` functions."""
    size = width_pt / _POINTS_PER_INCH, height_pt / _POINTS_PER_INCH
    figure = Figure(figsize=size, layout="constrained")
    return figure, figure.add_subplot()


def logarithmic(axes: Axes, which: Literal["x", "y"], labels: FuncFormatter) -> None:
    """Make an axis logarithmic with written labels and a faint grid."""
    axes.set(**{f"{which}scale": "log"})
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.set_major_formatter(labels)
    axis.set_minor_locator(NullLocator())
    axes.grid(axis=which)


def to_svg(figure: Figure, name: str, description: str) -> Markup:
    """Return a figure as an SVG element; for `in_style` functions.

    The name, of letters, digits and dashes, makes its identifiers unique on the page; the
    description is its text alternative. A wide figure scrolls, so that its text stays readable.
    """
    file = io.StringIO()
    with rc_context({"svg.hashsalt": name}):
        nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
        figure.savefig(file, format="svg", transparent=True, metadata=nothing)
    inside = file.getvalue().partition("</style>")[2].partition("</defs>")[2]
    inside = re.sub(r' id="[^"]+_\d+"', "", inside)  # of groups, the same in every figure
    for color, css in _THEMED.items():
        inside = inside.replace(color.lower(), css)
    width_pt, height_pt = (_POINTS_PER_INCH * length for length in figure.get_size_inches())
    is_wide = width_pt >= _WIDEST_PT
    least = f"min-width: {_LEAST_PX_PER_PT * width_pt:.0f}px; " if is_wide else ""
    svg = Markup(
        '<svg class="plot" role="img" aria-label="{}" style="{}--natural: {:g}in" '
        'viewBox="0 0 {:g} {:g}">{}'
    ).format(description, least, figure.get_figwidth(), width_pt, height_pt, Markup(inside))
    box = Markup('<div class="scroll" role="region" aria-label="{}" tabindex="0">{}</div>')
    return box.format(description, svg) if is_wide else svg


def with_legend(figure: Figure, name: str, description: str, **legend: Any) -> Markup:
    """Return a figure with the legend of its axes as SVG; for `in_style` functions."""
    figure.axes[0].legend(frameon=False, **legend)
    return to_svg(figure, name, description)


@in_style
def map_chart(
    values: Floats,
    name: str,
    title: str,
    limits: tuple[float, float] | None = None,
    colors: str = "viridis",
) -> Markup:
    """Return a map of pixels (rows, columns) with its color bar; unknown pixels are gray."""
    figure = Figure(figsize=(CHART_PT[0] / _POINTS_PER_INCH, CHART_PT[1] / _POINTS_PER_INCH))
    axes, bar = figure.add_axes(_MAP), figure.add_axes(_BAR)
    low, high = limits or color_limits(values)
    shades = colormaps[colors].with_extremes(bad=GRAY)
    picture = axes.imshow(values, cmap=shades, vmin=low, vmax=high, interpolation="nearest")
    figure.colorbar(picture, cax=bar, format=ScalarFormatter(useOffset=False))
    axes.set(title=title, xlabel="column", ylabel="row")
    return to_svg(figure, name, f"Map of the {title}")


def color_limits(*maps: Floats) -> tuple[float, float]:
    """Return the ends of a color scale that holds 98 % of the known pixels."""
    known = np.concatenate([each[np.isfinite(each)] for each in maps])
    low, high = np.percentile(known, (1, 99)) if known.size else (0.0, 1.0)
    return float(low), float(high)
