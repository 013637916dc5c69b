"""A measured curve of efficiency (PDP) or of the lens's transmission from a CSV file.

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

from megalopta.sensor.input_files import file_content

Point = tuple[float, float]


def with_curve(curve: Any, folder: Path, field: str = "efficiency") -> Any:
    """Replace `{path: FILE}` by the curve in the file; leave anything else as it is.

    Raises
    ------
    ValueError
        When a path and numbers are both given.
    """
    if not isinstance(curve, Mapping) or not isinstance(curve.get("path"), str):
        return curve
    if len(curve) > 1:
        others = ", ".join(str(name) for name in curve if name != "path")
        raise ValueError(f"{field}: path and {others} given; give a file or numbers, not both")
    return read_curve(folder / curve["path"], field)


def with_transmission(lens: Any, folder: Path) -> Any:
    """Do the same with the curve of a lens."""
    if not isinstance(lens, Mapping) or "transmission_curve" not in lens:
        return lens
    curve = with_curve(lens["transmission_curve"], folder, "lens.transmission_curve")
    return {**lens, "transmission_curve": curve}


def read_curve(path: Path, field: str = "efficiency") -> dict[str, tuple[float, ...]]:
    """Return the fields of `Efficiency` or `Transmission` that a CSV file holds.

    Raises
    ------
    ValueError
        When the file cannot be read, or a line is no point of a curve; names the line.
    """
    content = file_content(path, field)
    try:
        points = list(_points(content.decode("utf-8-sig"), path, field))
    except (UnicodeDecodeError, csv.Error):
        raise ValueError(f"{field}: {path} is no text in UTF-8; give a CSV file") from None
    if len(points) < 2:
        raise ValueError(f"{field}: {path} has {len(points)} points; give 2 or more")
    wavelengths, values = zip(*points, strict=True)
    return {"wavelengths_nm": wavelengths, "values": values}


def _points(text: str, path: Path, field: str) -> Iterator[Point]:
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if lines and not any(character.isdigit() for character in lines[0][1]):
        lines = lines[1:]
    last = 0.0
    for (number, _), row in zip(lines, csv.reader(line for _, line in lines), strict=True):
        wavelength, value = _point(row, f"{field}: line {number} of {path}")
        if not last < wavelength < math.inf:
            raise ValueError(
                f"{field}: line {number} of {path}: {wavelength:g} nm follows {last:g}; sort "
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
