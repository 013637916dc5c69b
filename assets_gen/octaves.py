"""Random fields of the plane in several bands of wavelengths, each where a mesh can show it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from megalopta.assets_gen import FloatArray
from megalopta.assets_gen.tileable_noise import PlaneWaves, plane_waves

WAVES = 56
"""Plane waves of a band."""
SAMPLED = 2.0, 3.5
"""A band is absent where a mesh has fewer points on its shortest wave than the first, and whole
from the second on."""


@dataclass(frozen=True)
class Octaves:
    """A rough field: bands of wavelengths that add up."""

    bands: tuple[PlaneWaves, ...]
    shortest_m: tuple[float, ...]
    """Shortest wavelength of each band (m)."""

    def __call__(self, points: FloatArray, step_m: FloatArray) -> FloatArray:
        """Return the field (n,) at points (n, 2) of a mesh with steps (n,) (m)."""
        total = np.zeros(len(points))
        for band, shortest in zip(self.bands, self.shortest_m, strict=True):
            share = np.clip((shortest / step_m - SAMPLED[0]) / (SAMPLED[1] - SAMPLED[0]), 0, 1)
            shown = share > 0
            total[shown] += share[shown] * band(points[shown])
        return total


def make_octaves(
    bands: Sequence[tuple[tuple[float, float], float]], rms: float, rng: np.random.Generator
) -> Octaves:
    """Return a random field of a root mean square, where all of it is shown.

    Bands are shortest and longest wavelength (m) and their part of the contrast.
    """
    whole = np.sqrt(sum(part**2 for _, part in bands))
    waves = (plane_waves(lengths, rms * part / whole, WAVES, rng) for lengths, part in bands)
    return Octaves(tuple(waves), tuple(lengths[0] for lengths, _ in bands))
