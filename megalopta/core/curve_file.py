"""Curve over wavelength in a CSV file: a line wavelength_nm,value for each point.

Comments after # and one line of column names are skipped:

    # bench, May
    wavelength_nm,efficiency
    400,0.021
    450,0.034
"""

import math
from collections.abc import Iterator

from megalopta.core.bounded import check_count

_MOST_BYTES, _MOST_LINES = 10**7, 20_000
Point = tuple[float, float]


def curve_of(content: bytes, place: str, quantity: str) -> dict[str, tuple[float, ...]]:
    """Return wavelengths_nm and values, from 0 to 1, of a file's content.

    Raises ValueError, which begins with `place`, if a line is not a point of a curve; it names the
    line and the `quantity`.
    """
    points = list(_points(content, place, quantity))
    if len(points) < 2:
        raise ValueError(f"{place} has {len(points)} points; give 2 or more")
    wavelengths, values = zip(*points, strict=True)
    return {"wavelengths_nm": wavelengths, "values": values}


def _lines(content: bytes, place: str) -> list[tuple[int, str]]:
    """Return the lines that hold numbers, and their places in the file."""
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(f"{place} is not UTF-8 text; give a CSV file") from None
    check_count(place, "bytes", len(content), _MOST_BYTES)
    all_lines = text.splitlines()
    check_count(place, "lines", len(all_lines), _MOST_LINES)
    bare = ((at, line.partition("#")[0].strip()) for at, line in enumerate(all_lines, 1))
    lines = [(at, line) for at, line in bare if line]
    has_names = lines and not any(character.isdigit() for character in lines[0][1])
    return lines[1:] if has_names else lines


def _points(content: bytes, place: str, quantity: str) -> Iterator[Point]:
    last = 0.0
    for at, line in _lines(content, place):
        wavelength, value = _numbers(line, f"{place}, line {at}", ("wavelength_nm", quantity))
        if not last < wavelength < math.inf:
            raise ValueError(
                f"{place}, line {at}: {wavelength:g} nm follows {last:g}; sort the lines by "
                "positive wavelengths, each once"
            )
        last = wavelength
        yield wavelength, value


def _numbers(line: str, place: str, names: tuple[str, str]) -> list[float]:
    """Return the numbers of a line, the last of them from 0 to 1."""
    try:
        numbers = [float(cell) for cell in line.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != len(names):
        raise ValueError(
            f"{place} is not {','.join(names)}; give two numbers, with a comma between them"
        )
    if not 0 <= numbers[-1] <= 1:
        raise ValueError(
            f"{place}: {names[-1]} {numbers[-1]:g} is not from 0 to 1; divide percents by 100"
        )
    return numbers
