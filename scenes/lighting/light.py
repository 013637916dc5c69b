"""The light of a scene: a named level, any part of which can be overridden."""

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
    """The light outside: a named level, any part of which can be overridden."""

    level: LevelName = "twilight"
    """Named light level: a sum of lights, with the spectrum of each."""

    illuminance_lux: Annotated[float, Field(ge=DIMMEST_LUX, le=BRIGHTEST_LUX)] | None = None
    """Illuminance of an unshaded horizontal plane (lux), to which all lights of the level are made
    stronger or weaker alike; None takes the level's, less what clouds hold back."""

    color_temperature_k: Annotated[float, Field(ge=1000, le=40000)] | None = None
    """Temperature of the Planckian spectrum (K) that all lights of the level take, each at its
    illuminance; None leaves them theirs. Not for airglow."""

    disc_fraction: Annotated[float, Field(ge=0, le=1)] | None = None
    """Share of the light of sun or moon that comes from the disc, and not from the sky that it
    lights; None takes 0.8. Only for levels with a disc."""

    disc_azimuth_deg: float = 120.0
    """Direction of the disc, counterclockwise from +x (degrees)."""

    disc_elevation_deg: Annotated[float, Field(gt=0, le=90)] = 50.0
    """Height of the disc above the horizon (degrees)."""

    cloud_cover: Annotated[float, Field(ge=0, le=1)] | None = None
    """Share of the sky that clouds cover (0 to 1). They hide the disc for as much of its light, and
    let through less, and less of the infrared; they have no shape. None is a clear sky."""

    sky: Literal["even", "natural"] = "even"
    """How the sky's light is spread: even, the same from all directions, or natural, as clear,
    overcast, twilit and starry skies have it. For scenes that are lit from outside."""

    panorama: PictureFile | None = None
    """HDR, EXR (linear sRGB) or PNG (sRGB) file of an equirectangular picture, 2:1, that lights the
    scene in place of sky and disc, at the level's illuminance and with white of its spectrum: the
    path, relative to the folder that the program runs in. For scenes that are lit from outside."""

    panorama_turn_deg: float = 0.0
    """Turns the panorama counterclockwise seen from above (degrees); at 0 its center lies toward
    +x."""

    @model_validator(mode="after")
    def _has_one_sky(self) -> "Light":
        if self.panorama:
            for name, usual in ("sky", "even"), ("disc_fraction", None):
                if getattr(self, name) != usual:
                    raise ValueError(
                        f"{name} {getattr(self, name)!r}: a panorama has a sky and a disc of its "
                        f"own; leave out {name} or panorama"
                    )
        return self

    @model_validator(mode="after")
    def _fits_the_level(self) -> "Light":
        if self.level == "airglow" and self.color_temperature_k is not None:
            raise ValueError(
                f"color_temperature_k {self.color_temperature_k:g}: level 'airglow' has a spectrum "
                "of its own; leave it out, or choose another level"
            )
        if self.disc_fraction and not LEVELS[self.level].disc:
            names = ", ".join(name for name, level in LEVELS.items() if level.disc)
            raise ValueError(
                f"disc_fraction {self.disc_fraction:g}: level {self.level!r} has no disc; leave it "
                f"out, or use one of {names}"
            )
        if self.cloud_cover and self.level == "overcast_night":
            raise ValueError(
                f"cloud_cover {self.cloud_cover:g}: level 'overcast_night' is overcast already; "
                "leave it out, or use level starlight"
            )
        return self

    def resolved(self) -> Level:
        """The level with all overrides applied."""
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
        """Whether it asks for a sky that only scenes lit from outside have."""
        return self.panorama is not None or self.sky != "even"

    def lighting(self) -> Lighting:
        """What shines on a scene from outside, as bright as the level."""
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
        """A light of the sky as it is spread over it."""
        shape = sky_shape(light.name, self.disc_azimuth_deg, self.disc_elevation_deg)
        return SkyPattern(light.irradiance.scaled(1 / math.pi), shape.astype(np.float32))


def _with_disc(level: Level, fraction: float) -> Level:
    """The light of sun or moon shared anew between its disc and the sky that it lights."""
    lit = {each.name: each for each in level.components}
    disc, sky = next((lit[a], lit[b]) for a, b in _OF_ONE_SOURCE.items() if a in lit)
    parts = shared((disc, sky), disc.illuminance_lux + sky.illuminance_lux, fraction)
    others = tuple(each for each in level.components if each not in (disc, sky))
    return Level(level.illuminance_lux, (*parts.components, *others))


def _clouded(level: Level, cover: float) -> Level:
    """Lights through the gaps, and what clouds make of the rest."""
    clear = tuple(each.scaled(1 - cover) for each in level.components) if cover < 1 else ()
    share = overcast_share(cover)
    clouds = overcast(level.components).scaled(share - (1 - cover))
    return Level(level.illuminance_lux * share, (*clear, clouds))
