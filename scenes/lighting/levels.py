"""Outdoor light in absolute units: named levels from daylight to an overcast night, or any lux.

The level fixes what an unshaded horizontal plane receives. A share of it comes from the disc of sun
or moon, 0.53° wide, the rest from a uniform sky; both have a Planckian spectrum. Levels after the
dissertation, §1.1; color temperatures are typical measured values. Real skies have gradients and
clouds, which this model leaves out.

Moon and airglow have spectra of their own in place of a Planckian. Use `airglow` for a moonless sky
beyond 900 nm, where it is twenty times as bright as `starlight` says.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal, get_args

from pydantic import Field, model_validator

from megalopta.record import Record
from megalopta.scenes.spectra import AIRGLOW, MOONLIGHT, Spectrum, luminous, planckian
from megalopta.scenes.world import Lighting, Sun

LevelName = Literal[
    "daylight", "twilight", "full_moon", "quarter_moon", "starlight", "airglow", "overcast_night"
]


@dataclass(frozen=True)
class Level:
    """What a named light level means."""

    illuminance_lux: float
    """On an unshaded horizontal plane."""
    shape: Spectrum
    """Of sky and disc, in any unit."""
    disc_fraction: float
    """Share of the illuminance that comes from the disc of sun or moon."""

    def spectrum(self) -> Spectrum:
        """Irradiance of an unshaded horizontal plane, W·m⁻²·nm⁻¹."""
        return self.shape.scaled(self.illuminance_lux / luminous(self.shape))


LEVELS: Mapping[str, Level] = {
    "daylight": Level(1e5, planckian(6500), 0.8),
    "twilight": Level(1.0, planckian(9000), 0.0),
    "full_moon": Level(0.25, MOONLIGHT, 0.8),
    "quarter_moon": Level(1e-2, MOONLIGHT, 0.8),
    "starlight": Level(1e-3, planckian(4500), 0.0),
    # three digits, for people to read: 0.02 % off the table
    "airglow": Level(round(math.pi * luminous(AIRGLOW), 6), AIRGLOW, 0.0),
    "overcast_night": Level(1e-4, planckian(4500), 0.0),
}

DIMMEST_LUX, BRIGHTEST_LUX = 1e-12, 1e9
"""Beyond all that there is outdoors, by eight and four orders of magnitude."""


class Light(Record, frozen=True):
    """The light outside: a named level, any part of which can be overridden."""

    level: LevelName = "twilight"
    """Named light level: sets illuminance, color and the share of the disc."""

    illuminance_lux: Annotated[float, Field(ge=DIMMEST_LUX, le=BRIGHTEST_LUX)] | None = None
    """Illuminance of an unshaded horizontal plane (lux); None takes the level's."""

    color_temperature_k: Annotated[float, Field(ge=1000, le=40000)] | None = None
    """Temperature of the Planckian spectrum (K); None takes the level's. Not for airglow."""

    disc_fraction: Annotated[float, Field(ge=0, le=1)] | None = None
    """Share of the illuminance from the disc of sun or moon; None takes the level's."""

    disc_azimuth_deg: float = 120.0
    """Direction of the disc, counterclockwise from +x (degrees)."""

    disc_elevation_deg: Annotated[float, Field(gt=0, le=90)] = 50.0
    """Height of the disc above the horizon (degrees)."""

    @model_validator(mode="after")
    def _airglow_keeps_its_spectrum(self) -> "Light":
        for field in ("color_temperature_k", "disc_fraction"):
            if self.level == "airglow" and getattr(self, field) is not None:
                raise ValueError(
                    f"{field} {getattr(self, field):g}: level 'airglow' has a spectrum of its own "
                    "and no disc; leave it out, or choose another level"
                )
        return self

    def resolved(self) -> Level:
        """The level with all overrides applied."""
        named, temperature_k = LEVELS[self.level], self.color_temperature_k
        return Level(
            _first(self.illuminance_lux, named.illuminance_lux),
            named.shape if temperature_k is None else planckian(temperature_k),
            _first(self.disc_fraction, named.disc_fraction),
        )

    def lighting(self) -> Lighting:
        """Sky radiance and disc irradiance that give the level's illuminance."""
        level = self.resolved()
        horizontal = level.spectrum()
        elevation = math.radians(self.disc_elevation_deg)
        azimuth = math.radians(self.disc_azimuth_deg)
        direction = (
            math.cos(elevation) * math.cos(azimuth),
            math.cos(elevation) * math.sin(azimuth),
            math.sin(elevation),
        )
        facing = horizontal.scaled(level.disc_fraction / math.sin(elevation))
        return Lighting(
            sky=horizontal.scaled((1 - level.disc_fraction) / math.pi),
            sun=Sun(direction, facing) if level.disc_fraction else None,
        )


def illuminance_of(level: str | float) -> float:
    """Illuminance (lux) of a level given by name or directly in lux.

    Raises
    ------
    ValueError
        For an unknown name or an illuminance that is not between the dimmest and brightest.
    """
    if isinstance(level, str):
        if level not in LEVELS:
            names = ", ".join(get_args(LevelName))
            raise ValueError(f"light level {level!r} is unknown: use one of {names}, or lux")
        return LEVELS[level].illuminance_lux
    if not DIMMEST_LUX <= level <= BRIGHTEST_LUX:
        raise ValueError(
            f"light level {level:g} lux: give between {DIMMEST_LUX:g} and {BRIGHTEST_LUX:g} lux"
        )
    return float(level)


def _first(override: float | None, named: float) -> float:
    return named if override is None else override
