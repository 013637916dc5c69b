"""A figure as four files: a picture to look at, one to print, and its numbers twice."""

import csv
import math
from pathlib import Path
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG

from megalopta.core.files import atomic_write, write_json
from megalopta.plotting.picture import Cell, Figure
from megalopta.plotting.style import house_style, new_canvas


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
    with atomic_write(numbers) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerows([figure.columns, *([_cell(each) for each in row] for row in figure.rows)])
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
        "findings": figure.findings,
        "columns": figure.columns,
        "rows": [[_json(value) for value in row] for row in figure.rows],
        **figure.details,
    }


def _json(value: Cell) -> Cell | None:
    return value if isinstance(value, str) or math.isfinite(value) else None


def _cell(value: Cell) -> str:
    # nine digits: more would show the rounding of one machine's arithmetic
    return value if isinstance(value, str) else f"{value:.9g}"
