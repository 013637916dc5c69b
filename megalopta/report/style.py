"""House style of all figures, and charts of pages as SVG in light and dark.

Colors are those of Okabe and Ito (2008), for color-blind readers; curves also differ in marker or
dash. Only matplotlib's object interface is used: no window, no state shared between figures.
"""

import io
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal
from zlib import crc32

import matplotlib
import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.colors import hsv_to_rgb, to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, FuncFormatter, NullLocator, ScalarFormatter
from matplotlib.typing import LineStyleType

from megalopta.core.arrays import Floats
from megalopta.flow.detectors.registry import METHODS

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
METHOD_COLORS = {
    **{"BM": BLUE, "IIA": ORANGE, "EMD": GREEN, "NDM": VERMILION, "NDS": PURPLE, "IM": SKY},
    **{"LK": "#A5002D", "FB": "#3C5A00", "DIS": "#879600", "TV-L1": "#005A5A", "ILK": "#694B2D"},
    **{"PC": "#4B4B69", "BA": "#96783C", "PM": "#FF4B5A", "PPM": "#C39687"},
    **{"PF": "#780FB4", "PF-fast": "#9669FF", "PPF": "#C30F87", "DualTVL1": "#5A2D3C"},
    **{"DeepFlow": "#00C31E", "PCAFlow": "#A5A5C3", "RLOF": "#A5A587", "zero": "#787878"},
}
"""One color a method, on all pages and pictures; those after the first six are as far apart (18 or
more by CIEDE2000) as light and dark pages allow"""

DASHES: tuple[LineStyleType, ...] = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)))

_STYLE = matplotlib.rc_params_from_file(
    Path(__file__).with_name("house.mplstyle"), use_default_template=False
)


@cache
def _free_colors() -> tuple[str, ...]:
    """Return colors, each as far as possible from those before it and of all methods (CIELAB)."""
    from skimage.color import rgb2lab

    axes = np.meshgrid(np.arange(48) / 48, (0.6, 1), (0.4, 0.6, 0.8))
    shades = hsv_to_rgb(np.stack(axes, -1).reshape(-1, 3))
    colors = [to_rgb(color) for color in (*METHOD_COLORS.values(), BLACK, GRAY)]
    for _ in range(8):
        nearest = np.linalg.norm(rgb2lab(shades)[:, None] - rgb2lab(colors), axis=-1).min(axis=1)
        colors.append(shades[nearest.argmax()])
    return tuple(to_hex(color) for color in colors[-8:])


def method_style(name: str, among: Sequence[str] = ()) -> dict[str, Any]:
    """Return color, marker, dash and width of a method: dashed on roots of counts (√).

    All forms of DIS have its color. A method that is not in the list, such as a Python function, is
    thick, in a color of its own by its place `among` those of the plot, or by its name.
    """
    forms = r"(?m)^(.+?)(?: (tuned|√|NLM))?$"
    (name, form), *others = re.findall(forms, "\n".join((name, *among)))
    number = list(METHODS).index(name) if name in METHODS else crc32(name.encode())
    color, own = METHOD_COLORS.get(name), [other for other, _ in others if other not in METHODS]
    if color is None:
        free = _free_colors()
        color = free[(own.index(name) if name in own else number) % len(free)]
    return {
        "color": color,
        "marker": MARKERS[(number + number // len(MARKERS)) % len(MARKERS)],
        "linestyle": {"√": "--", "NLM": ":"}.get(form, "-"),
        **({} if name in METHODS else {"linewidth": 3.5}),
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


_POINTS_PER_INCH = 72
CHART_PT = 380, 270
"""Width and height (pt); also the width of a page on a telephone, so that text keeps its size"""
_MAP_PT = 258, 210
"""Largest width and height of a map; constants are faster than a layout"""

NUMBERS = FuncFormatter(
    lambda value, _: EngFormatter(sep="")(value) if value >= 1000 else f"{value:g}"
)
"""Labels of an axis: 0.01, 1, 10k"""

in_style = house_style({"svg.fonttype": "none", "axes.grid": False})
"""Decorator: draw in the page's style, lines and markers included."""


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

    The name makes its identifiers unique on the page. A wide figure scrolls.
    """
    file = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": name}):
        nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
        figure.savefig(file, format="svg", transparent=True, metadata=nothing, dpi=200)
    inside = file.getvalue().partition("</style>")[2].partition("</defs>")[2]
    inside = re.sub(r' id="[^"]+_\d+"', "", inside)  # of groups, the same in every figure
    for color, css in {BLACK: "currentColor", RULE: "var(--rule)"}.items():
        inside = inside.replace(color.lower(), css)
    width_pt, height_pt = (_POINTS_PER_INCH * length for length in figure.get_size_inches())
    is_wide = width_pt >= 460  # pt; telephones would make its text too small
    least = f"min-width: {0.75 * width_pt:.0f}px; " if is_wide else ""  # px per pt
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
    rows, columns = values.shape
    map_pt = min(max(_MAP_PT[0] * rows / columns, 60.0), _MAP_PT[1])
    width, height = CHART_PT[0], map_pt + 60
    figure = Figure(figsize=(width / _POINTS_PER_INCH, height / _POINTS_PER_INCH))
    axes = figure.add_axes((38 / width, 36 / height, _MAP_PT[0] / width, map_pt / height))
    bar = figure.add_axes((304 / width, 46 / height, 10 / width, (map_pt - 20) / height))
    low, high = limits or color_limits(values)
    shades = matplotlib.colormaps[colors].with_extremes(bad=GRAY)
    picture = axes.imshow(values, cmap=shades, vmin=low, vmax=high, interpolation="nearest")
    figure.colorbar(picture, cax=bar, format=ScalarFormatter(useOffset=False), extend="both")
    axes.set(title=title, xlabel="column", ylabel="row")
    return to_svg(figure, name, f"Map of the {title}")


def color_limits(*maps: Floats) -> tuple[float, float]:
    """Return the ends of a color scale that holds 98 % of the known pixels, or the usual ones."""
    known = np.concatenate([values[np.isfinite(values)] for values in maps])
    if not known.size:
        return 0.0, 1.0
    low, lower, median, upper, high = np.percentile(known, (1, 25, 50, 75, 99)).tolist()
    spread = 6 * (upper - lower) or np.inf  # few hot pixels would darken all others
    return max(low, median - spread), min(high, median + spread)
