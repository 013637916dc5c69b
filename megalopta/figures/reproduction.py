"""Figures and tables of the dissertation, drawn again from the models of this package.

Each becomes a picture to look at (PNG), one to print (SVG) and the numbers behind it (CSV, and JSON
with parameters and intervals). The bytes depend on the versions of this package, of NumPy and of
matplotlib only; those of table-4.times and leaderboard on the machine as well.
"""

import csv
import math
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from typing import Any

from megalopta.errors import UserError
from megalopta.experiments import Sweep, pixels_of, run
from megalopta.figures.chapter2 import CHAPTER_2, COUNTER, MOTION, TRANSFER
from megalopta.figures.chapter3 import CTIA_PIXEL, CTIA_SUPPRESSION
from megalopta.figures.chapter4 import CHAPTER_4, CHAPTER_4_SCENES, TABLE, figure_4_3, write_page
from megalopta.figures.detection import DETECTION
from megalopta.figures.figure import Cell, Figure, Registry
from megalopta.figures.leaderboard import LIMIT
from megalopta.figures.style import house_style, new_canvas
from megalopta.figures.sweep import sweep_figure
from megalopta.files import atomic_write, write_json
from megalopta.folders import ensure_directory

__all__ = ["FIGURES", "Figure", "reproduce"]

FIGURES: Registry = {
    **CHAPTER_2,
    **COUNTER,
    **MOTION,
    **TRANSFER,
    **CTIA_PIXEL,
    **CTIA_SUPPRESSION,
    **CHAPTER_4_SCENES,
    **DETECTION,
    **LIMIT,
}


GROUPS: Mapping[str, tuple[str, ...]] = {
    "chapter-4": (*CHAPTER_4_SCENES, *CHAPTER_4),
    "all": (*FIGURES, *CHAPTER_4),
}
"""Names that stand for several."""


def reproduce(
    names: Sequence[str],
    out: Path,
    is_quick: bool = False,
    workers: int | None = None,
    cache: Path | None = None,
) -> list[Path]:
    """Write NAME.png, NAME.svg, NAME.csv and NAME.json into a folder for every figure named.

    Parameters
    ----------
    names : sequence of str
        Keys of `FIGURES`, `CHAPTER_4` or `GROUPS`.
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

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    UserError
        When a name is unknown, none is given or the folder is a file; nothing is written then.
    """
    if not names:
        raise UserError(f"reproduce: name at least one figure of {', '.join(GROUPS['all'])}")
    for name in names:
        _check_name(name)
    single = dict.fromkeys(each for name in names for each in _members(name, is_quick))
    figures: Registry = {**FIGURES, "fig-4.3": partial(figure_4_3, cache)}
    drawn = ensure_directory(out / "quick" if is_quick else out)
    plans = [CHAPTER_4[name] for name in single if name in CHAPTER_4]
    trials = [trial for plan in plans for trial in plan.trials(is_quick)]
    templates = pixels_of((trial.template for trial in trials), cache)
    results = run(trials, templates, out / "trials", workers)
    paths: list[Path] = []
    planned: list[Figure] = []
    for name in single:
        if name in CHAPTER_4:
            planned.append(CHAPTER_4[name].figure(is_quick, results, templates))
        paths += write_figure(planned[-1] if name in CHAPTER_4 else figures[name](), drawn)
    return [*paths, write_page(drawn, planned)] if TABLE in single else paths


def reproduce_sweep(
    name: str, sweep: Sweep, out: Path, workers: int | None = None, cache: Path | None = None
) -> list[Path]:
    """Measure a sweep and write its figure; as `reproduce`.

    Parameters
    ----------
    name : str
        Of the files.
    sweep
    out, workers, cache
        As in `reproduce`.
    """
    ensure_directory(out)
    templates = pixels_of((trial.template for trial in sweep.trials), cache)
    results = run(sweep.trials, templates, out / "trials", workers)
    return write_figure(sweep_figure(name, sweep, results), out)


def write_figure(figure: Figure, out: Path) -> list[Path]:
    """Draw one figure and write its four files."""
    paths = [out / f"{figure.name}.{kind}" for kind in ("png", "svg", "csv", "json")]
    with house_style():
        table = [("", "Ours", "Dissertation"), *figure.printed] if figure.printed else []
        canvas = new_canvas(figure.title, figure.caption, figure.height_in, table)
        figure.draw(canvas)
        canvas.draw_without_rendering()
        canvas.set_layout_engine("none")  # laid out once is enough for both pictures
        title = figure.title
        for path, metadata in zip(
            paths, ({"Title": title}, {"Title": title, "Date": None}), strict=False
        ):
            with atomic_write(path) as temporary:
                canvas.savefig(temporary, metadata=metadata)
    _write_csv(figure, paths[2])
    write_json(paths[3], _record(figure))
    return paths


def _write_csv(figure: Figure, path: Path) -> None:
    with atomic_write(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(figure.columns)
        writer.writerows([_cell(value) for value in row] for row in figure.rows)


def _record(figure: Figure) -> dict[str, Any]:
    rows = [[_json(value) for value in row] for row in figure.rows]
    return {
        "name": figure.name,
        "title": figure.title,
        "caption": figure.caption,
        "printed": [each._asdict() for each in figure.printed],
        "findings": figure.findings,
        "columns": figure.columns,
        "rows": rows,
        **figure.details,
    }


def _json(value: Cell) -> Cell | None:
    return value if isinstance(value, str) or math.isfinite(value) else None


def _cell(value: Cell) -> str:
    # nine digits: more would show the rounding of one machine's arithmetic
    return value if isinstance(value, str) else f"{value:.9g}"


def _members(name: str, is_quick: bool) -> tuple[str, ...]:
    if name == "chapter-4" and is_quick:
        return tuple(CHAPTER_4)  # the scenes have no quick form, and need all four forests
    return GROUPS.get(name, (name,))


def _check_name(name: str) -> None:
    known = (*GROUPS, *FIGURES, *CHAPTER_4)
    if name not in known:
        near = get_close_matches(name, known, n=3, cutoff=0.4)
        hint = f"did you mean {' or '.join(near)}?" if near else f"there are {', '.join(known)}"
        raise UserError(f"reproduce: no figure {name!r}; {hint}")
