"""How the light of the sky is spread over it, from direction to direction.

Clear and overcast skies are those of ISO 15469 (CIE S 011), types 12 and 1: a gradation from zenith
to horizon times, under a disc, the glow around it. Airglow comes from a thin layer, which is longer
toward the horizon, and dims in the air (Krisciunas and Schaefer 1991, PASP 103, 1033, Eq. 2 and 3);
so does starlight, which is densest in the plane of the Milky Way: a flat layer of stars, seen from
inside. For twilight see `twilight_sky`. Below the horizon all go on as they are there.
"""

import math
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from megalopta.scenes.lighting.components import ComponentName
from megalopta.scenes.lighting.twilight_sky import twilight_sky
from megalopta.scenes.scene import pattern_directions

Floats = NDArray[np.float64]
Shape = Callable[[Floats, Floats], Floats]

ROWS = 90
"""Of a pattern; it has twice as many columns."""
GALACTIC_POLE = math.cos(math.radians(30)), 0.0, math.sin(math.radians(30))
"""Where the north pole of the Milky Way stands, so that its band rises to 60°."""

_EXTINCTION_MAG = 0.172
"""In V, of light that crosses the air once (Krisciunas and Schaefer 1991)."""
_STAR_LAYER = 0.15
"""Height of the layer of stars over how far it is seen: its plane is 3.3 times as bright as the
mean of the sky, and seven times as bright as its poles."""


def sky_shape(name: ComponentName, disc_azimuth_deg: float, disc_elevation_deg: float) -> Floats:
    """Pattern (H, 2·H) of a light of the sky, of the layout of `SkyPattern`.

    Its mean over the upper hemisphere, weighted with the cosine to the zenith, is 1. The direction
    is that of the disc of sun or moon; twilight takes its azimuth alone.
    """
    azimuth, elevation = math.radians(disc_azimuth_deg), math.radians(disc_elevation_deg)
    level = math.cos(elevation)
    disc = np.array([level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation)])
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
    """Length of the way through a thin layer, over that to the zenith."""
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
"""Brightness, in any unit, from directions (n, 3) above the horizon, with the disc in one (3,)."""
