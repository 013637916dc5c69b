"""Relief of a stem: furrows in its bark, roots and buttresses.

Shape and texture come from one pattern, so that furrows are dark. The mean radius is unchanged.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from megalopta.assets_gen import FloatArray
from megalopta.assets_gen.plants.species import Buttresses
from megalopta.assets_gen.plants.tube import tube_uv

GRAIN_M = (0.012, 0.035)
"""Mesh steps of the carved stem, around and along it (m)."""
SIDES = 24, 112
"""Fewest and most sides of a carved stem."""
CARVED_M = 2.5, 4.0
"""Heights at which furrows begin to fade and end (m)."""
DEEPEST = 0.25
"""Largest depth of furrows, relative to the stem's radius."""


@dataclass(frozen=True)
class Furrows:
    """Furrows of one kind of bark."""

    pattern: NDArray[np.float32]
    """(H, W): 0 on ridges to 1 in furrows, over one tile of the bark's texture."""
    depth_m: float
    """Depth of furrows (m)."""

    def carved(
        self,
        axis: FloatArray,
        profile: FloatArray,
        tile_m: tuple[float, float],
        uv_origin: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Return axis (l, 3) and profile (l - 1, sides) of a stem as `sweep` takes them, carved.

        Parameters
        ----------
        axis, profile
            Axis and profile of the smooth stem, as for `sweep`.
        tile_m, uv_origin
            Tiling of its texture, with an integer number of tiles around.
        """
        radius = float(profile.mean(axis=1).max())
        sides = int(np.clip(np.ceil(2 * np.pi * radius / GRAIN_M[0]), *SIDES))
        axis, profile = _refined(axis, profile, sides)
        u, v = np.moveaxis(tube_uv(axis, profile, tile_m, whole_tiles=True)[:-1], -1, 0)
        place = np.stack([v, u]).reshape(2, -1, sides + 1)[..., :-1] + uv_origin[::-1, None, None]
        steps = np.array(GRAIN_M[::-1]) / tile_m[::-1] * self.pattern.shape
        smooth = gaussian_filter(self.pattern.astype(float), steps / 3, mode="wrap")
        texels = place * np.array(smooth.shape)[:, None, None] - 0.5
        depth = map_coordinates(smooth, texels, order=1, mode="grid-wrap") - smooth.mean()
        z = axis[:-1, 2]
        shown = np.clip((CARVED_M[1] - z) / (CARVED_M[1] - CARVED_M[0]), 0, 1) * (z > -0.1)
        most = min(self.depth_m, DEEPEST * radius)
        return axis, profile - most * shown[:, None] * depth


def _refined(axis: FloatArray, profile: FloatArray, sides: int) -> tuple[FloatArray, FloatArray]:
    """Return axis and profile with more rings, where furrows are, and with `sides` sides."""
    z = axis[:, 2]
    place = np.arange(len(axis), dtype=float)
    top = min(CARVED_M[1], z[-2])
    at = np.interp(np.arange(z[0], top, GRAIN_M[1]), z, place)
    at = np.union1d(at.round(6), place)
    fine = np.stack([np.interp(at, place, axis[:, i]) for i in range(3)], axis=-1)
    before = np.fft.rfft(profile, axis=1) / profile.shape[1]
    around = np.fft.irfft(before, sides, axis=1) * sides
    rings = np.stack([np.interp(at[:-1], place[:-1], column) for column in around.T], axis=-1)
    return fine, rings


BUTTRESSED_SIDES = 36
"""Sides of a stem with buttresses: enough for their edges."""
SHARPNESS = 9
"""Exponent of a buttress's outline around the stem; larger is thinner."""


def root_flare(
    z: FloatArray, sides: int, radius_m: float, flare: float, rng: np.random.Generator
) -> FloatArray:
    """Return the factor (k, sides) by which the stem widens into roots near the ground.

    Roots are lobes of two incommensurate numbers around the stem, so that no two are alike.
    """
    angle = 2 * np.pi * np.arange(sides) / sides
    first, second = rng.uniform(0, 2 * np.pi, 2)
    lobes = 0.6 + 0.3 * np.cos(3 * angle + first) + 0.25 * np.cos(5 * angle + second)
    decay = np.exp(-np.maximum(z, 0) / (2.2 * radius_m))
    return np.asarray(1 + flare * decay[:, None] * np.maximum(lobes, 0.1))


def buttress_flare(
    z: FloatArray, sides: int, buttresses: Buttresses, rng: np.random.Generator
) -> FloatArray:
    """Return the factor (k, sides) by which buttresses widen the stem."""
    count = buttresses.count
    middles = 2 * np.pi * (np.arange(count) + rng.uniform(-0.2, 0.2, count)) / count
    angle = 2 * np.pi * np.arange(sides)[:, None] / sides
    walls = np.cos((angle - middles) / 2) ** (2 * SHARPNESS)
    reach = buttresses.reach * rng.uniform(0.6, 1.2, count)
    tall = buttresses.height_m * rng.uniform(0.7, 1.2, count)
    fall = np.exp(-np.maximum(z, 0)[:, None] / tall)
    return np.asarray(1 + (reach * fall) @ walls.T)
