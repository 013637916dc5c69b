"""A measured efficiency curve from a CSV file.

    # comments and one line of column names may stand first
    wavelength_nm,efficiency
    400,0.021
    450,0.034

The file is read once, and its numbers take its place in the sensor's description.
"""

import csv
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from megalopta.sensor import file_content

Point = tuple[float, float]


def with_curve(efficiency: Any, folder: Path) -> Any:
    """Replace `{path: FILE}` by the curve in the file; leave anything else as it is."""
    if not isinstance(efficiency, Mapping) or not isinstance(efficiency.get("path"), str):
        return efficiency
    if len(efficiency) > 1:
        others = ", ".join(str(name) for name in efficiency if name != "path")
        raise ValueError(f"efficiency: path and {others} given; give a file or numbers, not both")
    return read_curve(folder / efficiency["path"])


def read_curve(path: Path) -> dict[str, tuple[float, ...]]:
    """Return the fields of `Efficiency` that a CSV file holds.

    Raises
    ------
    ValueError
        When the file cannot be read, or a line is no point of a curve; names the line.
    """
    content = file_content(path, "efficiency")
    try:
        points = list(_points(content.decode("utf-8-sig"), path))
    except (UnicodeDecodeError, csv.Error):
        raise ValueError(f"efficiency: {path} is no text in UTF-8; give a CSV file") from None
    if len(points) < 2:
        raise ValueError(f"efficiency: {path} has {len(points)} points; give 2 or more")
    wavelengths, values = zip(*points, strict=True)
    return {"wavelengths_nm": wavelengths, "values": values}


def _points(text: str, path: Path) -> Iterator[Point]:
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if lines and not any(character.isdigit() for character in lines[0][1]):
        lines = lines[1:]
    last = 0.0
    for (number, _), row in zip(lines, csv.reader(line for _, line in lines), strict=True):
        wavelength, value = _point(row, f"efficiency: line {number} of {path}")
        if not last < wavelength < math.inf:
            raise ValueError(
                f"efficiency: line {number} of {path}: {wavelength:g} nm follows {last:g}; sort "
                "the lines by positive wavelengths, each once"
            )
        last = wavelength
        yield wavelength, value


def _point(row: list[str], place: str) -> Point:
    try:
        wavelength, value = (float(cell) for cell in row)
    except ValueError:
        raise ValueError(
            f"{place}: {','.join(row)!r} is not wavelength_nm,efficiency; give two numbers, with a "
            "comma between them"
        ) from None
    if not 0 <= value <= 1:
        raise ValueError(
            f"{place}: efficiency {value:g} is not from 0 to 1; divide percents by 100"
        )
    return wavelength, value
