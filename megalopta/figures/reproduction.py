"""Figures and tables of the dissertation, drawn again from the models of this package.

Each becomes a picture to look at (PNG), one to print (SVG) and the numbers behind it (CSV, and JSON
with parameters and intervals). The bytes depend on the versions of this package, of NumPy and of
matplotlib only; those of table-4.times and leaderboard on the machine as well.
"""

import csv
import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG

from megalopta.errors import UserError
from megalopta.experiments import Sweep, Trial, pixels_of, run
from megalopta.figures.picture import Cell, Figure
from megalopta.figures.recipe import Run
from megalopta.figures.registry import find, names
from megalopta.figures.side_by_side import side_by_side
from megalopta.figures.style import house_style, new_canvas
from megalopta.figures.sweep import sweep_figure
from megalopta.files import atomic_write, write_json
from megalopta.folders import ensure_directory
from megalopta.progress import progress


def reproduce(
    figures: Sequence[str],
    out: Path,
    is_quick: bool = False,
    workers: int | None = None,
    cache: Path | None = None,
    scheduler: str | None = None,
) -> list[Path]:
    """Write NAME.png, NAME.svg, NAME.csv and NAME.json of every figure named; return their paths.

    Parameters
    ----------
    figures : sequence of str
        Names of figures or `GROUPS`.
    out : Path
        Made if it does not exist; files of the same name are replaced. Results of the flow
        benchmark are kept in its folder `trials`, and are not measured again. With Table 4.1 comes
        a page, chapter-4.html.
    is_quick : bool
        Whether to draw the figures of Chapter 4 in their quick form, into the folder `quick` of
        `out`: whole ones stay as they are.
    workers : int, optional
        Threads that measure; by default one for each core. Changes no number.
    cache : Path, optional
        Folder of rendered panoramas; by default the user's.
    scheduler : str, optional
        Address of a Dask cluster that measures instead of threads.

    Raises
    ------
    UserError
        When a name is unknown, none is given or the folder is a file; nothing is written then.
    """
    if not figures:
        raise UserError(f"reproduce: name at least one figure of {', '.join(names())}")
    recipes = {recipe.name: recipe for name in figures for recipe in find(name)}.values()
    drawn = ensure_directory(out / "quick" if is_quick else out)
    trials = [trial for recipe in recipes for trial in recipe.trials(is_quick)]
    measured = _measure(trials, out, is_quick, workers, cache, scheduler)
    made = [recipe.make(measured) for recipe in recipes]
    paths = _write_figures(made, drawn)
    return paths + [recipe.page(drawn, made) for recipe in recipes if recipe.page]


def reproduce_sweep(
    name: str,
    sweep: Sweep,
    out: Path,
    workers: int | None = None,
    cache: Path | None = None,
    scheduler: str | None = None,
) -> list[Path]:
    """Measure a sweep and write its figure under this name; else as `reproduce`."""
    ensure_directory(out)
    measured = _measure(sweep.trials, out, False, workers, cache, scheduler)
    return write_figure(sweep_figure(name, sweep, measured.results), out)


def _measure(
    trials: Sequence[Trial],
    out: Path,
    is_quick: bool,
    workers: int | None,
    cache: Path | None,
    scheduler: str | None,
) -> Run:
    templates = pixels_of((trial.template for trial in trials), cache)
    results = run(trials, templates, out / "trials", workers, scheduler)
    return Run(is_quick, results, templates, cache)


def _write_figures(figures: Sequence[Figure], out: Path) -> list[Path]:
    paths: list[Path] = []
    with progress("Drawing figures", len(figures), "figure") as advance:
        for written in side_by_side([partial(write_figure, figure, out) for figure in figures]):
            paths += written
            advance()
    return paths


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
