"""Light of a scene: a named level, any part of which can be overridden, and its sky.

Clear and overcast skies are those of ISO 15469 (CIE S 011), types 12 and 1: a gradation from zenith
to horizon, times the glow around the disc if there is one. Airglow comes from a thin layer, whose
path is longer toward the horizon, and is dimmed by air (Krisciunas and Schaefer 1991, PASP 103,
1033, Eq. 2 and 3). So is starlight, which is brightest in the plane of the Milky Way: a flat layer
of stars, seen from inside. Below the horizon all keep their value at the horizon.
"""

import math
from collections.abc import Callable, Mapping
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from megalopta.core.arrays import Floats
from megalopta.core.record import Record
from megalopta.scenes import levels, twilight
from megalopta.scenes.hashed_file import PictureFile
from megalopta.scenes.levels import LEVELS, ComponentName, Illumination, LevelName
from megalopta.scenes.scene import Environment, Lighting, SkyPattern, Sun, pattern_directions
from megalopta.scenes.spectra.color import primaries
from megalopta.scenes.spectra.outdoors import overcast_share
from megalopta.scenes.spectra.spectrum import flat, total


class Light(Record, frozen=True):
    """Outdoor light: a named level, any part of which can be overridden."""

    level: LevelName = "twilight"
    """Named light level: a sum of lights, with the spectrum of each."""
    illuminance_lux: (
        Annotated[float, Field(ge=levels.DIMMEST_LUX, le=levels.BRIGHTEST_LUX)] | None
    ) = None
    """Illuminance of an unshaded horizontal plane (lux), to which all lights of the level are
    scaled; null: that of the level, reduced by clouds."""
    disc_fraction: Annotated[float, Field(ge=0, le=1)] | None = None
    """Share of the light of sun or moon that comes from the disc instead of the sky that it lights;
    null: 0.8. Only for levels with a disc."""
    disc_azimuth_deg: float = 120.0
    """Direction of the disc, counterclockwise from +x (degrees)."""
    disc_elevation_deg: Annotated[float, Field(gt=0, le=90)] = 50.0
    """Elevation of the disc above the horizon (degrees)."""
    cloud_cover: Annotated[float, Field(ge=0, le=1)] | None = None
    """Share of the sky covered by clouds (0 to 1). They block the disc in proportion, and transmit
    less light, especially infrared; they have no shape; null: clear sky."""
    sky: Literal["even", "natural"] = "even"
    """Distribution of the sky's light: even, the same from all directions, or natural, as of clear,
    overcast, twilight and starry skies. For scenes that are lit from outside."""
    panorama: PictureFile | None = None
    """Path, in YAML below the file's folder, of an HDR, EXR (linear sRGB) or PNG (sRGB)
    equirectangular picture, 2:1. It lights the scene in place of sky and disc, at the level's
    illuminance, with the level's spectrum as white. For scenes that are lit from outside."""
    panorama_turn_deg: float = 0.0
    """Counterclockwise turn of the panorama seen from above (degrees); at 0 its center is toward
    +x."""

    @model_validator(mode="after")
    def _parts_fit(self) -> "Light":
        for name, usual in ("sky", "even"), ("disc_fraction", None):
            if self.panorama and getattr(self, name) != usual:
                raise ValueError(
                    f"{name} {getattr(self, name)!r}: a panorama has its own sky and disc; "
                    f"omit {name} or panorama"
                )
        if self.disc_fraction and not LEVELS[self.level].disc:
            names = ", ".join(name for name, level in LEVELS.items() if level.disc)
            raise ValueError(
                f"disc_fraction {self.disc_fraction:g}: level {self.level!r} has no disc; omit it, "
                f"or use one of {names}"
            )
        if self.cloud_cover and self.level == "overcast_night":
            raise ValueError(
                f"cloud_cover {self.cloud_cover:g}: level 'overcast_night' is already overcast; "
                "omit it, or use level starlight"
            )
        return self

    def resolved(self) -> Illumination:
        """Return the level with all overrides applied."""
        level = LEVELS[self.level]
        if self.disc_fraction is not None and level.disc:
            disc, sky, *night = level.components
            of_source = disc.illuminance_lux + sky.illuminance_lux
            parts = levels.shared((disc, sky), of_source, self.disc_fraction)
            level = Illumination(level.illuminance_lux, (*parts.components, *night))
        if self.cloud_cover:
            gaps, share = 1 - self.cloud_cover, overcast_share(self.cloud_cover)
            clear = tuple(light.scaled(gaps) for light in level.components) if gaps > 0 else ()
            clouds = levels.overcast(level.components).scaled(share - gaps)
            level = Illumination(level.illuminance_lux * share, (*clear, clouds))
        if self.illuminance_lux is not None:
            level = levels.scaled(self.illuminance_lux, level.components)
        return level

    def lighting(self) -> Lighting:
        """Return the light on a scene from outside, as bright as the level."""
        level = self.resolved()
        if self.panorama:
            spectra, lux = primaries(level.spectrum()), level.illuminance_lux
            picture = Environment(self.panorama, self.panorama_turn_deg, spectra, lux)
            return Lighting(flat(0.0), panorama=picture)
        direction = _direction(self.disc_azimuth_deg, self.disc_elevation_deg)
        facing = level.disc and level.disc.irradiance.scaled(1 / direction[2])
        sun = Sun(direction, facing) if facing else None
        skies = [light for light in level.components if not light.is_disc]
        if self.sky == "even":
            return Lighting(total([light.irradiance for light in skies]).scaled(1 / math.pi), sun)
        patterns = []
        for light in skies:
            shape = sky_shape(light.name, self.disc_azimuth_deg, self.disc_elevation_deg)
            radiance = light.irradiance.scaled(1 / math.pi)
            patterns.append(SkyPattern(radiance, shape.astype(np.float32)))
        return Lighting(flat(0.0), sun, tuple(patterns))


def _direction(azimuth_deg: float, elevation_deg: float) -> tuple[float, float, float]:
    azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
    level = math.cos(elevation)
    return level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation)


Shape = Callable[[Floats, Floats], Floats]

ROWS = 90
"""Rows of a pattern; it has twice as many columns."""
GALACTIC_POLE = math.cos(math.radians(30)), 0.0, math.sin(math.radians(30))
"""Direction of the north pole of the Milky Way, whose band then rises to 60°."""

_EXTINCTION_MAG = 0.172
"""Extinction in V of light that crosses the air once (Krisciunas and Schaefer 1991)."""
_STAR_LAYER = 0.15
"""Height of the layer of stars relative to the visible range: its plane is 3.3 times as bright as
the mean of the sky, and seven times as bright as its poles."""


def sky_shape(name: ComponentName, disc_azimuth_deg: float, disc_elevation_deg: float) -> Floats:
    """Pattern (H, 2·H) of a sky light, in the layout of `SkyPattern`.

    Its mean over the upper hemisphere, weighted with the cosine to the zenith, is 1. The direction
    is that of the disc of sun or moon; twilight uses only its azimuth.
    """
    disc = np.array(_direction(disc_azimuth_deg, disc_elevation_deg))
    upper = ROWS // 2
    directions = pattern_directions(ROWS)[:upper].reshape(-1, 3)
    values = SHAPES[name](directions, disc).reshape(upper, 2 * ROWS)
    edges = np.sin(np.pi * np.arange(upper + 1) / ROWS) ** 2
    values = values / np.average(values.mean(axis=1), weights=np.diff(edges))
    return np.vstack([values, np.repeat(values[-1:], ROWS - upper, axis=0)])


def _clear(directions: Floats, disc: Floats) -> Floats:
    angle = np.arccos(np.clip(directions @ disc, -1, 1))
    glow = 1 + 10 * (np.exp(-3 * angle) - np.exp(-3 * np.pi / 2)) + 0.45 * np.cos(angle) ** 2
    return np.asarray((1 - np.exp(-0.32 / directions[:, 2])) * glow)


def _way(directions: Floats) -> Floats:
    """Path length through a thin layer, relative to that to the zenith."""
    return np.asarray((1 - 0.96 * (1 - directions[:, 2] ** 2)) ** -0.5)


def _airglow(directions: Floats, disc: Floats) -> Floats:
    way = _way(directions)
    return np.asarray(way * 10 ** (-0.4 * _EXTINCTION_MAG * (way - 1)))


def _stars(directions: Floats, disc: Floats) -> Floats:
    layer = 1 / (np.abs(directions @ np.array(GALACTIC_POLE)) + _STAR_LAYER)
    return np.asarray(layer * 10 ** (-0.4 * _EXTINCTION_MAG * (_way(directions) - 1)))


SHAPES: Mapping[ComponentName, Shape] = {
    "daylit sky": _clear,
    "moonlit sky": _clear,
    "clouds": lambda directions, disc: 1 + 4 * np.exp(-0.7 / directions[:, 2]),
    "airglow": _airglow,
    "starlight": _stars,
    "twilight": lambda directions, disc: twilight.sky(directions, math.atan2(disc[1], disc[0])),
}
"""Brightness, any unit, from directions (n, 3) above the horizon, with the disc in one (3,)."""
