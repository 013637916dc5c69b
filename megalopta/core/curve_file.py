"""Curve over wavelength in a CSV file: a line wavelength_nm,value for each point.

Comments after # and one line of column names are skipped:

    # bench, May
    wavelength_nm,efficiency
    400,0.021
    450,0.034
"""

import math
from collections.abc import Iterator

Point = tuple[float, float]


def curve_of(content: bytes, place: str, quantity: str) -> dict[str, tuple[float, ...]]:
    """Return wavelengths_nm and values, from 0 to 1, of a file's content.

    Raises ValueError, which begins with `place`, if a line is not a point of a curve; it names the
    line and the `quantity`.
    """
    try:
        points = list(_points(content.decode("utf-8-sig"), place, quantity))
    except UnicodeDecodeError:
        raise ValueError(f"{place} is not UTF-8 text; give a CSV file") from None
    if len(points) < 2:
        raise ValueError(f"{place} has {len(points)} points; give 2 or more")
    wavelengths, values = zip(*points, strict=True)
    return {"wavelengths_nm": wavelengths, "values": values}


def _points(text: str, place: str, quantity: str) -> Iterator[Point]:
    bare = ((at, line.partition("#")[0].strip()) for at, line in enumerate(text.splitlines(), 1))
    lines = [(at, line) for at, line in bare if line]
    if lines and not any(character.isdigit() for character in lines[0][1]):
        lines = lines[1:]
    last = 0.0
    for at, line in lines:
        wavelength, value = _point(line, f"{place}, line {at}", quantity)
        if not last < wavelength < math.inf:
            raise ValueError(
                f"{place}, line {at}: {wavelength:g} nm follows {last:g}; sort the lines by "
                "positive wavelengths, each once"
            )
        last = wavelength
        yield wavelength, value


def _point(line: str, place: str, quantity: str) -> Point:
    try:
        wavelength, value = (float(cell) for cell in line.split(","))
    except ValueError:
        raise ValueError(
            f"{place}: {line!r} is not wavelength_nm,{quantity}; give two numbers, with a comma "
            "between them"
        ) from None
    if not 0 <= value <= 1:
        raise ValueError(
            f"{place}: {quantity} {value:g} is not from 0 to 1; divide percents by 100"
        )
    return wavelength, value
