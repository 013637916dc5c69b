"""The axes of a liana: ropes that hang between the ground and the crowns.

Each rope goes up from the ground, sags sideways in one or two loops between the heights at which it
holds on, and bears its leaves in its upper half, among the crowns.
"""

import numpy as np

from megalopta.assets_gen import FloatArray, unit
from megalopta.assets_gen.plants.branching import (
    BURIED_M,
    GOLDEN_ANGLE,
    UP,
    Branching,
    outward,
    sideways,
)
from megalopta.assets_gen.plants.skeleton import IndexArray, Skeleton
from megalopta.assets_gen.plants.species import Climbing, Species

STEP_M = 0.45
HOLDS = 4
"""Places where a rope holds on, its upper end included."""


def grow_climbing(species: Species, growth: Climbing, rng: np.random.Generator) -> Branching:
    """Return the axes of one liana of `species.stems` ropes."""
    skeleton = Skeleton(np.empty((0, 3)), np.empty(0, dtype=np.intp))
    bearing: list[IndexArray] = []
    for rope in range(species.stems):
        line = _rope(species, growth, rope * GOLDEN_ANGLE + rng.normal(0, 0.4), rng)
        first = len(skeleton.positions)
        skeleton = skeleton.with_chain(line)
        bearers = np.sort(rng.integers(len(line) // 2, len(line), growth.shoots)) + first
        ahead = unit(skeleton.internodes()[bearers])
        toward = sideways(ahead, rng.uniform(0, 2 * np.pi, len(bearers))) - 0.4 * UP
        ends = skeleton.positions[bearers] + growth.shoot_m * unit(toward)
        bearing.append(np.stack([bearers, len(skeleton.positions) + np.arange(len(ends))], axis=-1))
        skeleton = skeleton.extended(ends, bearers)
    return Branching(skeleton, np.concatenate(bearing))


def _rope(
    species: Species, growth: Climbing, azimuth: float, rng: np.random.Generator
) -> FloatArray:
    """Return the nodes (k, 3) of a rope from below the ground to its upper end (m)."""
    height = species.height_m * rng.uniform(0.8, 1)
    levels = np.sort(rng.uniform(0.25, 0.9, HOLDS - 1))
    z = np.concatenate([[-BURIED_M], height * levels, [height]])
    away = growth.reach_m * np.concatenate([[0.0], rng.uniform(0.1, 1, HOLDS)])
    turns = azimuth + rng.normal(0, 0.7, HOLDS + 1)
    holds = away[:, None] * outward(turns) + z[:, None] * UP
    pieces = [
        _hanging(low, high, sag, rng)
        for low, high, sag in zip(holds[:-1], holds[1:], rng.uniform(0, 0.2, HOLDS), strict=True)
    ]
    return np.concatenate([holds[:1], *pieces])


def _hanging(low: FloatArray, high: FloatArray, sag: float, rng: np.random.Generator) -> FloatArray:
    """Return the nodes (k, 3) from one hold, which is left out, to the next: a slack rope."""
    span = float(np.linalg.norm(high - low))
    share = np.linspace(0, 1, 2 + int(span / STEP_M))[1:, None]
    slack = 4 * share * (1 - share)
    wave = np.sin(2 * np.pi * share + rng.uniform(0, 2 * np.pi)) * slack
    across = outward(rng.uniform(0, 2 * np.pi, 1))
    return low + share * (high - low) + sag * span * slack * across + 0.06 * wave * across
