"""Light levels by name, from daylight to an overcast night, and their components.

Every light has its own spectrum and source. Sun and moon are discs; all other lights are a uniform
sky.

Illuminances follow the dissertation, §1.1; lights stronger than the night sky supply the part
beyond airglow and starlight. Four fifths of the light of sun or moon come from its disc, 0.53°
wide. The moonless forest floor is the dimmest light in which *Megalopta* flies (Kelber et al. 2006,
Behav. Ecol. 17, 63), 1e-4 cd/m² of a white surface: for scenes without trees, and for readings. A
forest shades itself; use `starlight` for it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

from megalopta.core.errors import nearest
from megalopta.scenes.spectra import outdoors
from megalopta.scenes.spectra.spectrum import Spectrum, common_range, luminous, total

ComponentName = Literal[
    "sun", "daylit sky", "moon", "moonlit sky", "twilight", "airglow", "starlight", "clouds"
]


@dataclass(frozen=True)
class Component:
    """Component of the outdoor light, as received by an unshaded horizontal plane."""

    name: ComponentName
    """Name of the light; `scenes/spectra/outdoors.py` has the source of its spectrum."""
    irradiance: Spectrum
    """Irradiance of the plane, W·m⁻²·nm⁻¹."""

    @property
    def is_disc(self) -> bool:
        """True if it comes from the disc of sun or moon, False if from the whole sky."""
        return self.name in ("sun", "moon")

    @property
    def illuminance_lux(self) -> float:
        """Illuminance of the plane."""
        return luminous(self.irradiance)

    def scaled(self, factor: float) -> "Component":
        """Return the light multiplied by a factor."""
        return replace(self, irradiance=self.irradiance.scaled(factor))

    def giving(self, illuminance_lux: float) -> "Component":
        """Return the light scaled to an illuminance."""
        return self.scaled(illuminance_lux / self.illuminance_lux)


AIRGLOW_SKY = Component("airglow", outdoors.AIRGLOW.scaled(math.pi))
STARS = Component("starlight", outdoors.STARLIGHT.scaled(math.pi))
"""Mean starlight of the whole sky."""
DAY = Component("sun", outdoors.SUN), Component("daylit sky", outdoors.CLEAR_SKY)
FULL, QUARTER = (
    (
        Component("moon", outdoors.moonlit(outdoors.SUN, disc)),
        Component("moonlit sky", outdoors.moonlit(outdoors.CLEAR_SKY, disc)),
    )
    for disc in (outdoors.FULL_MOON, outdoors.QUARTER_MOON)
)
"""Disc and sky of these are in arbitrary units and differ in brightness."""


def overcast(components: tuple[Component, ...]) -> Component:
    """Light through a closed layer of cloud, with the total illuminance of its components."""
    light = total([component.irradiance for component in components])
    wavelengths = sorted({*light.wavelengths_nm, *outdoors.OVERCAST.wavelengths_nm})
    values = light(wavelengths) * outdoors.OVERCAST(wavelengths)
    color = Spectrum.of(wavelengths, values, common_range([light, outdoors.OVERCAST]))
    return Component("clouds", color).giving(luminous(light))


LevelName = Literal[
    "daylight",
    "twilight",
    "full_moon",
    "quarter_moon",
    "starlight",
    "airglow",
    "moonless_forest_floor",
    "overcast_night",
]

DISC_FRACTION = 0.8
"""Share of the light of sun or moon that comes from the disc."""


@dataclass(frozen=True)
class Illumination:
    """Definition of a named light level."""

    illuminance_lux: float
    """Illuminance of an unshaded horizontal plane."""
    components: tuple[Component, ...]
    """Its components, which together give the illuminance."""

    def spectrum(self) -> Spectrum:
        """Irradiance of an unshaded horizontal plane, W·m⁻²·nm⁻¹."""
        return total([light.irradiance for light in self.components])

    @property
    def disc(self) -> Component | None:
        """Light of the disc of sun or moon, if any."""
        return next((light for light in self.components if light.is_disc), None)


def shared(lights: tuple[Component, Component], lux: float, disc_fraction: float) -> Illumination:
    """Disc and sky of sun or moon that together give an illuminance."""
    disc, sky = lights
    parts = (disc.giving(lux * disc_fraction), sky.giving(lux * (1 - disc_fraction)))
    return Illumination(lux, tuple(light for light in parts if max(light.irradiance.values)))


def scaled(illuminance_lux: float, components: tuple[Component, ...]) -> Illumination:
    """Lights scaled by a common factor to give an illuminance."""
    factor = illuminance_lux / sum(light.illuminance_lux for light in components)
    return Illumination(illuminance_lux, tuple(light.scaled(factor) for light in components))


_STARLIGHT_LUX = 1e-3
_NIGHT = (AIRGLOW_SKY, STARS.giving(_STARLIGHT_LUX - AIRGLOW_SKY.illuminance_lux))
"""Moonless sky; its stars are scaled to four fifths of the published brightness."""
_NIGHT_LUX = sum(light.illuminance_lux for light in _NIGHT)
_TWILIT_SKY = Component("twilight", outdoors.TWILIGHT.scaled(math.pi)).giving(1.0 - _NIGHT_LUX)
_FAINT_STARS = Component("starlight", outdoors.FAINT_STARLIGHT.scaled(math.pi))


def _moonlit(illuminance_lux: float, moon: tuple[Component, Component]) -> Illumination:
    """Moon and its sky, which supply the part beyond the night sky."""
    lights = shared(moon, illuminance_lux - _NIGHT_LUX, DISC_FRACTION).components
    return Illumination(illuminance_lux, (*lights, *_NIGHT))


LEVELS: Mapping[str, Illumination] = {
    "daylight": shared(DAY, 1e5, DISC_FRACTION),
    "twilight": Illumination(1.0, (_TWILIT_SKY, *_NIGHT)),
    "full_moon": _moonlit(0.25, FULL),
    "quarter_moon": _moonlit(1e-2, QUARTER),
    "starlight": Illumination(_STARLIGHT_LUX, _NIGHT),
    # three digits, for readability: 0.03 % off the table
    "airglow": scaled(8.19e-4, (AIRGLOW_SKY, _FAINT_STARS)),
    "moonless_forest_floor": scaled(math.pi * 1e-4, _NIGHT),
    "overcast_night": scaled(1e-4, (overcast(_NIGHT),)),
}

DIMMEST_LUX, BRIGHTEST_LUX = 1e-12, 1e9
"""Limits, eight and four orders of magnitude beyond outdoor light."""


def illuminance_of(level: str | float) -> float:
    """Illuminance (lux) of a level given by name or directly in lux.

    Raises ValueError for an unknown name or an illuminance that is not between the dimmest and
    brightest.
    """
    if isinstance(level, str):
        if level not in LEVELS:
            remedy = nearest(level, LEVELS, "give lux, or one of")
            raise ValueError(f"light level {level!r} is unknown; {remedy}")
        return LEVELS[level].illuminance_lux
    if not DIMMEST_LUX <= level <= BRIGHTEST_LUX:
        raise ValueError(
            f"light level {level:g} lux: give between {DIMMEST_LUX:g} and {BRIGHTEST_LUX:g} lux"
        )
    return float(level)
