"""Light levels, errors and titles as text of pages."""

import math

from megalopta.config.model import Configuration, LightLevel
from megalopta.core.quantities import UNDEFINED, percent, short
from megalopta.scenes.levels import illuminance_of


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
    """Format an illuminance: "10 lux", "100 000 lux", "0.00031 lux"."""
    return f"{short(illuminance_lux)}\u00a0lux"
