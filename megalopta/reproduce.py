"""Figures and tables of the dissertation, drawn again from the models of this package.

Each becomes a picture to look at (PNG), one to print (SVG) and the numbers behind it (CSV). The
bytes depend on the versions of this package, of NumPy and of matplotlib only.
"""

import csv
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path

from megalopta.errors import UserError
from megalopta.figure import Cell, Figure, Registry
from megalopta.figures_chapter2 import CHAPTER_2
from megalopta.figures_chapter2_counter import COUNTER
from megalopta.figures_chapter2_motion import MOTION
from megalopta.figures_chapter2_transfer import TRANSFER
from megalopta.figures_chapter3_pixel import CTIA_PIXEL
from megalopta.figures_chapter3_suppression import CTIA_SUPPRESSION
from megalopta.figures_chapter4_scenes import CHAPTER_4_SCENES
from megalopta.figures_detection import DETECTION
from megalopta.figures_leaderboard import LIMIT
from megalopta.files import made_folder, whole_file
from megalopta.plot_style import house_style, new_canvas

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


def reproduce(names: Sequence[str], out: Path) -> list[Path]:
    """Write NAME.png, NAME.svg and NAME.csv into a folder for every figure named.

    Parameters
    ----------
    names : sequence of str
        Keys of `FIGURES`.
    out : Path
        Made if it does not exist; files of the same name are replaced.

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
        raise UserError(f"reproduce: name at least one figure of {', '.join(FIGURES)}")
    for name in names:
        _check_name(name)
    made_folder(out)
    return [path for name in names for path in write_figure(FIGURES[name](), out)]


def write_figure(figure: Figure, out: Path) -> list[Path]:
    """Draw one figure and write its three files."""
    paths = [out / f"{figure.name}.{kind}" for kind in ("png", "svg", "csv")]
    with house_style():
        canvas = new_canvas(figure.title, figure.caption, figure.height_in)
        figure.draw(canvas)
        title = f"{figure.name}: {figure.title}"
        for path, metadata in zip(
            paths, ({"Title": title}, {"Title": title, "Date": None}), strict=False
        ):
            with whole_file(path) as temporary:
                canvas.savefig(temporary, metadata=metadata)
    _write_csv(figure, paths[-1])
    return paths


def _write_csv(figure: Figure, path: Path) -> None:
    with whole_file(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(figure.columns)
        writer.writerows([_cell(value) for value in row] for row in figure.rows)


def _cell(value: Cell) -> str:
    # nine digits: more would show the rounding of one machine's arithmetic
    return value if isinstance(value, str) else f"{value:.9g}"


def _check_name(name: str) -> None:
    if name not in FIGURES:
        near = get_close_matches(name, FIGURES, n=3, cutoff=0.4)
        hint = f"did you mean {' or '.join(near)}?" if near else f"there are {', '.join(FIGURES)}"
        raise UserError(f"reproduce: no figure {name!r}; {hint}")
