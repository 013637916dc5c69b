"""Light of a scene: a named level, any part of which can be overridden."""

import math
from collections.abc import Mapping
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from megalopta.core.record import Record
from megalopta.scenes.hashed_file import PictureFile
from megalopta.scenes.lighting.levels import (
    BRIGHTEST_LUX,
    DIMMEST_LUX,
    LEVELS,
    Component,
    ComponentName,
    Level,
    LevelName,
    overcast,
    scaled,
    shared,
)
from megalopta.scenes.lighting.sky_shapes import sky_shape
from megalopta.scenes.scene import Environment, Lighting, SkyPattern, Sun
from megalopta.scenes.spectra.color import primaries
from megalopta.scenes.spectra.outdoors import overcast_share
from megalopta.scenes.spectra.spectrum import flat, planckian, total

_OF_ONE_SOURCE: Mapping[ComponentName, ComponentName] = {"sun": "daylit sky", "moon": "moonlit sky"}


class Light(Record, frozen=True):
    """Outdoor light: a named level, any part of which can be overridden."""

    level: LevelName = "twilight"
    """Named light level: a sum of lights, with the spectrum of each."""

    illuminance_lux: Annotated[float, Field(ge=DIMMEST_LUX, le=BRIGHTEST_LUX)] | None = None
    """Illuminance of an unshaded horizontal plane (lux), to which all lights of the level are
    scaled; null: that of the level, reduced by clouds."""

    color_temperature_k: Annotated[float, Field(ge=1000, le=40000)] | None = None
    """Color temperature of a Planckian spectrum (K) for all lights of the level, each at its
    illuminance; null: their own spectra. Not for airglow."""

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
    """Path, relative to the working folder, of an HDR, EXR (linear sRGB) or PNG (sRGB)
    equirectangular picture, 2:1. It lights the scene in place of sky and disc, at the level's
    illuminance, with the level's spectrum as white. For scenes that are lit from outside."""

    panorama_turn_deg: float = 0.0
    """Counterclockwise turn of the panorama seen from above (degrees); at 0 its center is toward
    +x."""

    @model_validator(mode="after")
    def _has_one_sky(self) -> "Light":
        if self.panorama:
            for name, usual in ("sky", "even"), ("disc_fraction", None):
                if getattr(self, name) != usual:
                    raise ValueError(
                        f"{name} {getattr(self, name)!r}: a panorama has its own sky and disc; "
                        f"omit {name} or panorama"
                    )
        return self

    @model_validator(mode="after")
    def _fits_the_level(self) -> "Light":
        if self.level == "airglow" and self.color_temperature_k is not None:
            raise ValueError(
                f"color_temperature_k {self.color_temperature_k:g}: level 'airglow' has its own "
                "spectrum; omit it, or choose another level"
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

    def resolved(self) -> Level:
        """Return the level with all overrides applied."""
        level = LEVELS[self.level]
        if self.disc_fraction is not None and level.disc:
            level = _with_disc(level, self.disc_fraction)
        if self.cloud_cover:
            level = _clouded(level, self.cloud_cover)
        if self.color_temperature_k is not None:
            color = planckian(self.color_temperature_k)
            parts = tuple(each.giving(each.illuminance_lux, color) for each in level.components)
            level = Level(level.illuminance_lux, parts)
        if self.illuminance_lux is not None:
            level = scaled(self.illuminance_lux, level.components)
        return level

    @property
    def asks_for_a_sky(self) -> bool:
        """True if it needs a sky, which only scenes lit from outside have."""
        return self.panorama is not None or self.sky != "even"

    def lighting(self) -> Lighting:
        """Return the light on a scene from outside, as bright as the level."""
        level = self.resolved()
        if self.panorama:
            spectra, lux = primaries(level.spectrum()), level.illuminance_lux
            picture = Environment(self.panorama, self.panorama_turn_deg, spectra, lux)
            return Lighting(flat(0.0), panorama=picture)
        elevation = math.radians(self.disc_elevation_deg)
        azimuth = math.radians(self.disc_azimuth_deg)
        direction = (
            math.cos(elevation) * math.cos(azimuth),
            math.cos(elevation) * math.sin(azimuth),
            math.sin(elevation),
        )
        facing = level.disc and level.disc.irradiance.scaled(1 / math.sin(elevation))
        sun = Sun(direction, facing) if facing else None
        parts = [each for each in level.components if not each.is_disc]
        if self.sky == "even":
            return Lighting(total([each.irradiance for each in parts]).scaled(1 / math.pi), sun)
        return Lighting(flat(0.0), sun, tuple(map(self._spread, parts)))

    def _spread(self, light: Component) -> SkyPattern:
        """Distribution of a sky light over directions."""
        shape = sky_shape(light.name, self.disc_azimuth_deg, self.disc_elevation_deg)
        return SkyPattern(light.irradiance.scaled(1 / math.pi), shape.astype(np.float32))


def _with_disc(level: Level, fraction: float) -> Level:
    """Return the level with sun or moon light redistributed between disc and sky."""
    lit = {each.name: each for each in level.components}
    disc, sky = next((lit[a], lit[b]) for a, b in _OF_ONE_SOURCE.items() if a in lit)
    parts = shared((disc, sky), disc.illuminance_lux + sky.illuminance_lux, fraction)
    others = tuple(each for each in level.components if each not in (disc, sky))
    return Level(level.illuminance_lux, (*parts.components, *others))


def _clouded(level: Level, cover: float) -> Level:
    """Return lights through the gaps, and those through clouds."""
    clear = tuple(each.scaled(1 - cover) for each in level.components) if cover < 1 else ()
    share = overcast_share(cover)
    clouds = overcast(level.components).scaled(share - (1 - cover))
    return Level(level.illuminance_lux * share, (*clear, clouds))
