"""Light of a scene: a named level, any part of which can be overridden, and its sky.

Twilight is sunlight scattered once, by air. The sun is below the local horizon but still shines on
the air above it. Along a line of sight every parcel of air scatters the light that reaches it past
the Earth, in proportion to its density and to Rayleigh's phase function; air and ozone dim it
before and after. Multiply scattered light is nearly uniform over the sky. At this depth of the sun
it is about half of the light at the zenith (approximate; it grows from a third at sunset to nearly
all at a depth of 10°). The model: clean air at 550 nm in spherical shells, without refraction and
without aerosol, which would redden and broaden the glow above the sunset.

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
from pydantic import BeforeValidator, Field, model_validator
from scipy.interpolate import RegularGridInterpolator

from megalopta.core.arrays import Floats
from megalopta.core.record import Record
from megalopta.scenes.hashed_file import PictureFile
from megalopta.scenes.levels import (
    BRIGHTEST_LUX,
    DIMMEST_LUX,
    LEVELS,
    Component,
    ComponentName,
    Illumination,
    LevelName,
    level_named,
    overcast,
    scaled,
    shared,
)
from megalopta.scenes.scene import Environment, Lighting, SkyPattern, Sun, pattern_directions
from megalopta.scenes.spectra.color import primaries
from megalopta.scenes.spectra.outdoors import overcast_share
from megalopta.scenes.spectra.spectrum import flat, total

_OF_ONE_SOURCE: Mapping[ComponentName, ComponentName] = {"sun": "daylit sky", "moon": "moonlit sky"}


class Light(Record, frozen=True):
    """Outdoor light: a named level, any part of which can be overridden."""

    level: Annotated[LevelName, BeforeValidator(level_named)] = "twilight"
    """Named light level: a sum of lights, with the spectrum of each."""

    illuminance_lux: Annotated[float, Field(ge=DIMMEST_LUX, le=BRIGHTEST_LUX)] | None = None
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
            lit = {light.name: light for light in level.components}
            disc, sky = next((lit[a], lit[b]) for a, b in _OF_ONE_SOURCE.items() if a in lit)
            of_source = disc.illuminance_lux + sky.illuminance_lux
            parts = shared((disc, sky), of_source, self.disc_fraction)
            others = tuple(light for light in level.components if light not in (disc, sky))
            level = Illumination(level.illuminance_lux, (*parts.components, *others))
        if self.cloud_cover:
            gaps, share = 1 - self.cloud_cover, overcast_share(self.cloud_cover)
            clear = tuple(light.scaled(gaps) for light in level.components) if gaps > 0 else ()
            clouds = overcast(level.components).scaled(share - gaps)
            level = Illumination(level.illuminance_lux * share, (*clear, clouds))
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
        direction = _direction(self.disc_azimuth_deg, self.disc_elevation_deg)
        facing = level.disc and level.disc.irradiance.scaled(1 / direction[2])
        sun = Sun(direction, facing) if facing else None
        parts = [each for each in level.components if not each.is_disc]
        if self.sky == "even":
            return Lighting(total([each.irradiance for each in parts]).scaled(1 / math.pi), sun)
        return Lighting(flat(0.0), sun, tuple(map(self._spread, parts)))

    def _spread(self, light: Component) -> SkyPattern:
        """Distribution of a sky light over directions."""
        shape = sky_shape(light.name, self.disc_azimuth_deg, self.disc_elevation_deg)
        return SkyPattern(light.irradiance.scaled(1 / math.pi), shape.astype(np.float32))


def _direction(azimuth_deg: float, elevation_deg: float) -> tuple[float, float, float]:
    """Return the unit vector toward a place in the sky."""
    azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
    level = math.cos(elevation)
    return level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation)


SUN_DEPTH_DEG = 6.4
"""Depth of the sun below the horizon at which the twilight spectrum was measured (degrees)."""

_EARTH_KM, _TOP_KM = 6371.0, 80.0
_AIR_DEPTH, _AIR_SCALE_KM = 0.097, 8.0
"""Rayleigh optical depth of the air at 550 nm (Bodhaine et al. 1999), and its scale height."""
_OZONE_DEPTH, _OZONE_KM, _OZONE_WIDTH_KM = 0.027, 22.0, 5.0
"""Optical depth of 300 Dobson units, in a Gaussian layer."""
_EVENLY = 0.5
"""Share of multiply scattered light at the zenith."""
_STEPS, _SUN_STEPS = 80, 120


def twilight_sky(directions: Floats, sun_azimuth_rad: float) -> Floats:
    """Radiance from directions (n, 3), unit vectors above the horizon, relative to the zenith."""
    single = _scattered_once(np.vstack([directions, [0.0, 0.0, 1.0]]), sun_azimuth_rad)
    return np.asarray((1 - _EVENLY) * single[:-1] / single[-1] + _EVENLY)


def _scattered_once(directions: Floats, sun_azimuth_rad: float) -> Floats:
    """Radiance (n,) in arbitrary units."""
    depth = np.radians(SUN_DEPTH_DEG)
    level = np.cos(depth)
    sun = np.array(
        [level * np.cos(sun_azimuth_rad), level * np.sin(sun_azimuth_rad), -np.sin(depth)]
    )
    up = directions[:, 2:]
    way = np.sqrt((_EARTH_KM * up) ** 2 + 2 * _EARTH_KM * _TOP_KM + _TOP_KM**2) - _EARTH_KM * up
    # Steps that grow with distance: most of the air is low.
    edges = np.linspace(0, 1, _STEPS + 1) ** 2
    distance = way * (edges[1:] + edges[:-1]) / 2
    step = way * np.diff(edges)
    x, y, z = (distance * directions[:, k, None] for k in range(3))
    radius = np.sqrt(x**2 + y**2 + (z + _EARTH_KM) ** 2)
    height = radius - _EARTH_KM
    sine = (x * sun[0] + y * sun[1] + (z + _EARTH_KM) * sun[2]) / radius
    density = np.exp(-height / _AIR_SCALE_KM) / _AIR_SCALE_KM
    seen = np.exp(-np.cumsum(_extinction(height) * step, axis=1))
    angle = directions @ sun
    phase = 1 + angle[:, None] ** 2
    return np.asarray((density * phase * seen * _sunlight()((height, sine)) * step).sum(axis=1))


def _extinction(height_km: Floats) -> Floats:
    """Extinction per kilometer."""
    air = _AIR_DEPTH / _AIR_SCALE_KM * np.exp(-height_km / _AIR_SCALE_KM)
    off = (height_km - _OZONE_KM) / _OZONE_WIDTH_KM
    ozone = _OZONE_DEPTH / (_OZONE_WIDTH_KM * np.sqrt(2 * np.pi)) * np.exp(-(off**2) / 2)
    return np.asarray(air + ozone)


def _sunlight() -> RegularGridInterpolator:
    """Share of sunlight that reaches a height (km), by the sine of the sun's elevation."""
    heights = np.linspace(0, _TOP_KM, 81)
    sines = np.linspace(-0.35, 0.2, 221)
    radius = _EARTH_KM + heights[:, None, None]
    sine = sines[None, :, None]
    toward = radius * sine
    way = np.sqrt(toward**2 + (_EARTH_KM + _TOP_KM) ** 2 - radius**2) - toward
    edges = np.linspace(0, 1, _SUN_STEPS + 1)
    distance = way * (edges[1:] + edges[:-1]) / 2
    height = np.sqrt(radius**2 + distance**2 + 2 * distance * toward) - _EARTH_KM
    depth = (_extinction(height.clip(0)) * way * np.diff(edges)).sum(axis=-1)
    hidden = (sine[..., 0] < 0) & (radius[..., 0] * np.sqrt(1 - sine[..., 0] ** 2) < _EARTH_KM)
    return RegularGridInterpolator((heights, sines), np.where(hidden, 0.0, np.exp(-depth)))


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


def _overcast(directions: Floats, disc: Floats) -> Floats:
    return np.asarray(1 + 4 * np.exp(-0.7 / directions[:, 2]))


def _way(directions: Floats) -> Floats:
    """Path length through a thin layer, relative to that to the zenith."""
    return np.asarray((1 - 0.96 * (1 - directions[:, 2] ** 2)) ** -0.5)


def _airglow(directions: Floats, disc: Floats) -> Floats:
    way = _way(directions)
    return np.asarray(way * 10 ** (-0.4 * _EXTINCTION_MAG * (way - 1)))


def _stars(directions: Floats, disc: Floats) -> Floats:
    layer = 1 / (np.abs(directions @ np.array(GALACTIC_POLE)) + _STAR_LAYER)
    return np.asarray(layer * 10 ** (-0.4 * _EXTINCTION_MAG * (_way(directions) - 1)))


def _twilight(directions: Floats, disc: Floats) -> Floats:
    return twilight_sky(directions, math.atan2(disc[1], disc[0]))


SHAPES: Mapping[ComponentName, Shape] = {
    "daylit sky": _clear,
    "moonlit sky": _clear,
    "clouds": _overcast,
    "airglow": _airglow,
    "starlight": _stars,
    "twilight": _twilight,
}
"""Brightness, any unit, from directions (n, 3) above the horizon, with the disc in one (3,)."""
