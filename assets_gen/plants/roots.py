"""How a stem widens into its roots: a flare, and buttresses."""

import numpy as np

from megalopta.assets_gen import FloatArray
from megalopta.assets_gen.plants.species import Buttresses

BUTTRESSED_SIDES = 36
"""Sides of a stem with buttresses: enough for their edges."""
SHARPNESS = 9
"""Exponent of a buttress's outline around the stem; more is thinner."""


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
