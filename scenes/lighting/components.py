"""The lights that there are outside, each with its own spectrum and source; they add.

Sun and moon are discs, all else is a sky that is alike in all directions.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

from megalopta.scenes.spectra.airglow import AIRGLOW, FAINT_STARLIGHT
from megalopta.scenes.spectra.moonlight import FULL_MOON, QUARTER_MOON, moonlit
from megalopta.scenes.spectra.overcast import OVERCAST
from megalopta.scenes.spectra.photometry import luminous
from megalopta.scenes.spectra.spectrum import Spectrum, total
from megalopta.scenes.spectra.starlight import STARLIGHT
from megalopta.scenes.spectra.sunlight import CLEAR_SKY, SUN
from megalopta.scenes.spectra.twilight import TWILIGHT

ComponentName = Literal[
    "sun", "daylit sky", "moon", "moonlit sky", "twilight", "airglow", "starlight", "clouds"
]

SOURCES: Mapping[ComponentName, str] = {
    "sun": "ASTM G173-03, direct",
    "daylit sky": "Bird and Riordan 1986, air mass 1.5",
    "moon": "ASTM G173-03 × Kieffer and Stone 2005, at a phase of 7° or 90°",
    "moonlit sky": "Bird and Riordan 1986 × Kieffer and Stone 2005",
    "twilight": "Patat et al. 2006, sun at −6.4°; sunlight × λ⁻⁴ beyond 0.8 µm",
    "airglow": "Rousselot et al. 2000, Cuby et al. 2000, Maihara et al. 1993, Patat 2003",
    "starlight": "Roach and Gordon 1973; zodiac: Benn and Ellison 1998, Leinert et al. 1998",
    "clouds": "Kasten and Czeplak 1980, color by Meador and Weaver 1980, Hale and Querry 1973",
}
"""Where the spectrum of each component comes from; numbers are in `scenes/spectra`."""


@dataclass(frozen=True)
class Component:
    """One of the lights outside, as an unshaded horizontal plane gets it."""

    name: ComponentName
    """Which light it is; `SOURCES` tells where its spectrum comes from."""
    irradiance: Spectrum
    """Of the plane, W·m⁻²·nm⁻¹."""

    @property
    def is_disc(self) -> bool:
        """Whether it comes from the disc of sun or moon; else from all of the sky."""
        return self.name in ("sun", "moon")

    @property
    def illuminance_lux(self) -> float:
        """Of the plane."""
        return luminous(self.irradiance)

    def scaled(self, factor: float) -> "Component":
        """The same light, so many times as strong."""
        return replace(self, irradiance=self.irradiance.scaled(factor))

    def giving(self, illuminance_lux: float, shape: Spectrum | None = None) -> "Component":
        """The same light at an illuminance, of another spectrum where one is given."""
        found = shape or self.irradiance
        return replace(self, irradiance=found.scaled(illuminance_lux / luminous(found)))


AIRGLOW_SKY = Component("airglow", AIRGLOW.scaled(math.pi))
FAINT_STARS = Component("starlight", FAINT_STARLIGHT.scaled(math.pi))
"""Of the darkest part of the sky."""
STARS = Component("starlight", STARLIGHT.scaled(math.pi))
"""Mean of the whole sky."""
TWILIT_SKY = Component("twilight", TWILIGHT.scaled(math.pi))
DAY = Component("sun", SUN), Component("daylit sky", CLEAR_SKY)
FULL = (
    Component("moon", moonlit(SUN, FULL_MOON)),
    Component("moonlit sky", moonlit(CLEAR_SKY, FULL_MOON)),
)
QUARTER = (
    Component("moon", moonlit(SUN, QUARTER_MOON)),
    Component("moonlit sky", moonlit(CLEAR_SKY, QUARTER_MOON)),
)
"""Disc and sky of these are in any unit, and not as bright as each other."""


def overcast(components: tuple[Component, ...]) -> Component:
    """What a closed layer of cloud makes of lights, as bright as they are together."""
    light = total([each.irradiance for each in components])
    wavelengths = sorted({*light.wavelengths_nm, *OVERCAST.wavelengths_nm})
    values = light(wavelengths) * OVERCAST(wavelengths)
    color = Spectrum(tuple(wavelengths), tuple(map(float, values)))
    return Component("clouds", color).giving(luminous(light))
