"""A figure with its caption and numbers, and its files: two of the picture, one of the numbers."""

import re
import textwrap
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import rcParams
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure as Canvas

from megalopta.core.files import atomic_write, write_csv
from megalopta.report.style import BLACK, house_style

WIDTH_IN = 7.0
_MARGIN_IN = 0.12


@dataclass(frozen=True, eq=False)
class Figure:
    """One reproduced figure."""

    name: str
    """Name on the command line and of its files: "fig-4.5"."""
    title: str
    """Title, in one line; figures of the dissertation begin with their number: "Figure 3.2: …"."""
    caption: str
    """Content and method."""
    draw: Callable[[Canvas], None]
    """Draws axes on an empty matplotlib figure of the house style."""
    numbers: pd.DataFrame
    """Numbers behind the picture, with units in the names, as in "time_s"; NaN if missing."""
    height_in: float = 4.0
    """Height of the drawing (inches), without title and caption; it is 7 inches wide."""


def write_numbers(path: Path, numbers: pd.DataFrame) -> None:
    """Write the numbers of a figure or table as CSV."""
    # nine digits: more would show one machine's rounding
    write_csv(path, numbers.columns, numbers.itertuples(index=False), digits=9)


def write_figure(figure: Figure, out: Path) -> list[Path]:
    """Draw one figure, title above and caption below, and write its three files."""
    png, svg, numbers = paths = [out / f"{figure.name}.{kind}" for kind in ("png", "svg", "csv")]
    head, lines = _wrapped(figure.title, 62), _wrapped(figure.caption, 100)
    above = 0.24 * len(head) + 0.16
    below = 0.168 * len(lines) + 2 * _MARGIN_IN
    total = below + figure.height_in + above
    place: dict[str, Any] = {"x": _MARGIN_IN / WIDTH_IN, "va": "top", "color": BLACK}
    bold: dict[str, Any] = {"fontsize": 13, "fontweight": "bold"}
    small: dict[str, Any] = {"fontsize": 9.0, "linespacing": 1.3}
    with house_style():
        canvas = Canvas(figsize=(WIDTH_IN, total), dpi=rcParams["savefig.dpi"])
        FigureCanvasAgg(canvas)
        drawing = 0.0, below / total, 1.0, figure.height_in / total
        canvas.set_layout_engine("constrained", rect=drawing)
        canvas.text(y=1 - _MARGIN_IN / total, s="\n".join(head), **place, **bold)
        canvas.text(y=(below - _MARGIN_IN) / total, s="\n".join(lines), **place, **small)
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
        vectors: Any = FigureCanvasSVG(canvas)
        with atomic_write(svg) as temporary:
            vectors.print_svg(temporary, metadata={**title, "Date": None})
    write_numbers(numbers, figure.numbers)
    return paths


def _wrapped(text: str, characters: int) -> list[str]:
    """Wrap text into lines; a number stays with its unit."""
    held = re.sub(r"(?<=[\d×=]) (?=\S)| (?=[×=%])", "\N{NO-BREAK SPACE}", text)
    return textwrap.wrap(held, characters, break_on_hyphens=False)
