"""Numbers as people write them: digits, thin spaces, and one unit for a value and its error."""

import math
import re

UNDEFINED = "–"
_PREFIXES = ("f", "p", "n", "µ", "m", "", "k", "M", "G")
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def number(value: float | None) -> str:
    """Format three digits: "0.123", "12.3", "41\u202f200", "154 million", "3.14 · 10⁻⁵"."""
    if value is None or not math.isfinite(value):
        return UNDEFINED
    size = abs(value)
    if size >= 9.995e11 or 0 < size < 1e-4:
        digits, exponent = f"{value:.2e}".split("e")
        return f"{digits} · 10{str(int(exponent)).translate(_SUPERSCRIPTS)}"
    for unit, word in ((1e9, " billion"), (1e6, " million"), (1.0, "")):
        if size >= 0.9995 * unit:
            decimals = 2 - math.floor(math.log10(size / unit * 1.0005))
            return _grouped(value / unit, decimals) + word
    return f"{value:.3g}"


def short(value: float) -> str:
    """Format a round number without trailing digits: "10 million", "0.01", "10⁻⁵"."""
    text = re.sub(r"\.0+(?!\d)|(\.\d*[1-9])0+(?!\d)", r"\1", number(value))
    return text.removeprefix("1 · ")


def _grouped(value: float, decimals: int) -> str:
    """Round, and put thin spaces between the thousands of five digits or more."""
    text = f"{round(value, decimals) + 0.0:,.{max(decimals, 0)}f}"
    return text.replace(",", "\u202f" if abs(value) >= 9999.5 else "")


def with_error(value: float, error: float, unit: str) -> str:
    """Format a value and its error with one unit: "1.020 ± 0.003 µs"; without error three digits.

    The error has one digit, or two if the first is 1; seconds, meters, volts and hertz get a
    prefix.
    """
    has_error = math.isfinite(error) and error > 0
    scale, unit = _prefixed(max(abs(value), error if has_error else 0.0), unit)
    value /= scale
    if not has_error or not math.isfinite(value):
        return f"{short(value)} {unit}".strip()
    error /= scale
    if (size := max(abs(value), error)) < 1e-4:
        power = math.floor(math.log10(size))
        both = with_error(value / 10.0**power, error / 10.0**power, "")
        return f"({both}) · 10{str(power).translate(_SUPERSCRIPTS)} {unit}".strip()
    decimals = -math.floor(math.log10(error))
    decimals += round(error, decimals + 1) * 10.0**decimals < 1.95
    return f"{_grouped(value, decimals)} ± {_grouped(error, decimals)} {unit}".strip()


def between(low: float, high: float, unit: str) -> str:
    """Format the ends of a range with one unit: "0.255 to 6.83 µs"; equal ones once."""
    scale, unit = _prefixed(max(abs(low), abs(high)), unit)
    ends = dict.fromkeys((number(low / scale), number(high / scale)))
    return f"{' to '.join(ends)} {unit}".strip()


def _prefixed(size: float, unit: str) -> tuple[float, str]:
    """Return the size of a unit with the prefix that suits a size, and its name."""
    power = 0
    if unit in ("s", "m", "V", "Hz") and size and math.isfinite(size):  # units that take a prefix
        power = min(max(math.floor(math.log10(size) / 3 + 1e-9), -5), 3)
    return 1000.0**power, f"{_PREFIXES[power + 5] if power else ''}{unit}"


def percent(fraction: float | None) -> str:
    """Format a fraction as a percentage with two digits; 0 only if it is exactly zero."""
    if fraction is None or not math.isfinite(fraction):
        return UNDEFINED
    if 0 < fraction < 1e-4:
        return "< 0.01\u00a0%"
    decimals = max(0, 1 - math.floor(math.log10(100 * fraction))) if 0 < fraction < 0.1 else 0
    return f"{100 * fraction:.{decimals}f}\u00a0%"
