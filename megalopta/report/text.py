"""Numbers and names as text in the report."""

import math

from megalopta.config.model import Configuration, LightLevel
from megalopta.flow.metrics.photon_threshold import format_flux
from megalopta.scenes.levels import illuminance_of

UNDEFINED = "–"
_PREFIXES = ("f", "p", "n", "µ", "m", "", "k", "M", "G")


def number(value: float | None) -> str:
    """Format three digits, thousands with a prefix (12.3k), small numbers two digits (0.0012)."""
    if value is None or not math.isfinite(value):
        return UNDEFINED
    if value == 0:
        return "0"
    size = abs(value)
    if size >= 999.5:
        return ("-" if value < 0 else "") + format_flux(size)
    if size >= 99.95:
        return f"{value:.0f}"
    if size >= 0.9995:
        return f"{value:.1f}" if size >= 9.995 else f"{value:.2f}"
    if size >= 1e-4:
        return f"{value:.2g}"
    digits, exponent = f"{value:.1e}".split("e")
    superscript = str(int(exponent)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"10{superscript}" if digits == "1.0" else f"{digits} · 10{superscript}"


def with_error(value: float, error: float, unit: str) -> str:
    """Format a value and its error, of two digits, with one unit: "1.0200 ± 0.0029 µs".

    Units get a prefix but for "%".
    """
    power = 0
    if unit != "%" and value and math.isfinite(value):
        power = min(max(math.floor(math.log10(abs(value)) / 3 + 1e-9), -5), 3)
    value, error = value / 1000.0**power, error / 1000.0**power
    unit = f"{_PREFIXES[power + 5]}{unit}"
    if not (math.isfinite(error) and error > 0):
        return f"{number(value)} {unit}"
    digits = 1 - math.floor(math.log10(error))
    texts = (f"{round(size, digits):.{max(digits, 0)}f}" for size in (value, error))
    return f"{' ± '.join(texts)} {unit}"


def short(value: float) -> str:
    """Format a round number without trailing digits: 1k, 10M, 0.01."""
    text = number(value)
    digits = text.rstrip("kMGT")
    shortened = digits.rstrip("0").rstrip(".") if "." in digits else digits
    return shortened + text[len(digits) :]


def percent(fraction: float | None) -> str:
    """Format a fraction as a percentage with two digits; 0 only if it is exactly zero."""
    if fraction is None or not math.isfinite(fraction):
        return UNDEFINED
    if 0 < fraction < 1e-4:
        return "< 0.01\u00a0%"
    decimals = max(0, 1 - math.floor(math.log10(100 * fraction))) if 0 < fraction < 0.1 else 0
    return f"{100 * fraction:.{decimals}f}\u00a0%"


def relative_error(value: float | None) -> str:
    """Format an error as a percentage; "fails" from ten times the true value."""
    if value is None or not math.isfinite(value):
        return UNDEFINED
    return percent(value) if value < 10 else "fails"


def level_name(level: LightLevel) -> str:
    """Name of a light level: "full moon", "10 lux"."""
    return level.replace("_", "\u00a0") if isinstance(level, str) else lux(level)


def level_title(level: LightLevel) -> str:
    """Name and illuminance of a light level: "full moon, 0.25 lux"."""
    illuminance = f", {lux(illuminance_of(level))}" if isinstance(level, str) else ""
    return f"{level_name(level)}{illuminance}"


def title(configuration: Configuration) -> str:
    """Return the name of the sequence and its light levels."""
    name = configuration.name.replace("_", " ").replace("-", " ")
    if not configuration.scene.has_truth:
        return f"{name[0].upper()}{name[1:]}, as photons"
    levels = sorted(configuration.light_levels, key=illuminance_of, reverse=True)
    light = f"at {level_title(levels[0])}"
    if len(levels) > 1:
        light = f"from {level_name(levels[0])} to {level_name(levels[-1])}"
    return f"{name[0].upper()}{name[1:]}, {light}"


def lux(illuminance_lux: float) -> str:
    """Format an illuminance with three digits: "10 lux", "0.000314 lux"."""
    return f"{three_digits(illuminance_lux)}\u00a0lux"


def three_digits(value: float) -> str:
    """Format a number with three digits: "98700", "0.000314"."""
    return f"{float(f'{value:.3g}'):g}"
