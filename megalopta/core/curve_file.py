"""Curve over wavelength in a CSV file: a line wavelength_nm,value for each point.

Comments after # and one line of column names are skipped:

    # bench, May
    wavelength_nm,efficiency
    400,0.021
    450,0.034
"""

import math

from megalopta.core.bounded import check_count

_MOST_BYTES, _MOST_LINES = 10**7, 20_000


def curve_of(content: bytes, place: str, quantity: str) -> dict[str, tuple[float, ...]]:
    """Return wavelengths_nm and values, from 0 to 1, of a file's content.

    Raises ValueError, which begins with `place`, if a line is not a point of a curve; it names the
    line and the `quantity`.
    """
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
    wavelengths_nm, values, last_nm = list[float](), list[float](), 0.0
    for at, line in lines[1:] if has_names else lines:
        try:
            wavelength_nm, value = map(float, line.split(","))
        except ValueError:
            raise ValueError(
                f"{place}, line {at} is not wavelength_nm,{quantity}; give two numbers, with a "
                "comma between them"
            ) from None
        if not 0 <= value <= 1:
            raise ValueError(
                f"{place}, line {at}: {quantity} {value:g} is not from 0 to 1; divide percents by "
                "100"
            )
        if not last_nm < wavelength_nm < math.inf:
            raise ValueError(
                f"{place}, line {at}: {wavelength_nm:g} nm follows {last_nm:g}; sort the lines by "
                "positive wavelengths, each once"
            )
        wavelengths_nm.append(last_nm := wavelength_nm)
        values.append(value)
    if len(values) < 2:
        raise ValueError(f"{place} has {len(values)} points; give 2 or more")
    return {"wavelengths_nm": tuple(wavelengths_nm), "values": tuple(values)}
