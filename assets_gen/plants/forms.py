"""Axes of any plant, by growth form; axes of palms and lianas.

A palm has a stem without branches, and fronds at its end. Successive fronds are at the golden
angle, the oldest lowest, and arch over by their own weight. A frond has two rows of leaflets.

A liana has ropes that hang between the ground and the crowns. Each rises from the ground, sags
sideways in one or two loops between its holds, and bears its leaves in its upper half, among the
crowns.
"""

import numpy as np

from megalopta.assets_gen import FloatArray, unit
from megalopta.assets_gen.plants.branching import (
    BURIED_M,
    GOLDEN_ANGLE,
    UP,
    Branching,
    grow_colonized,
    grow_whorled,
    outward,
    sideways,
    stem_axis,
)
from megalopta.assets_gen.plants.skeleton import IndexArray, Skeleton
from megalopta.assets_gen.plants.species import Climbing, Colonized, Fronded, Species

NODES = 7
"""Internodes of a frond."""
STEM_STEP_M = 0.6
CLUMP_M = 0.5
"""Distance of a plant's stems from its middle (m)."""


def grow_fronded(species: Species, growth: Fronded, rng: np.random.Generator) -> Branching:
    """Return the axes of one palm; each frond bears leaflets from the stem to its tip."""
    skeleton = Skeleton(np.empty((0, 3)), np.empty(0, dtype=np.intp))
    bearing: list[IndexArray] = []
    for stem in range(species.stems):
        height = species.height_m - 0.45 * growth.frond_m
        height *= rng.uniform(0.5, 1) if stem else 1
        axis = stem_axis(max(height, 0.6), species.wander, STEM_STEP_M, rng)
        if species.stems > 1:
            axis += CLUMP_M * outward(np.array([stem * GOLDEN_ANGLE]))
        skeleton = skeleton.with_chain(axis)
        along = axis[-1] + _fronds(growth, rng)
        end = len(skeleton.positions) - 1
        own = end + 1 + np.arange(growth.fronds * NODES).reshape(growth.fronds, NODES)
        foot = np.full((growth.fronds, 1), end)
        bearing.append(np.concatenate([foot, own], axis=1))
        skeleton = skeleton.extended(along.reshape(-1, 3), bearing[-1][:, :-1].ravel())
    return Branching(skeleton, np.concatenate(bearing))


def _fronds(growth: Fronded, rng: np.random.Generator) -> FloatArray:
    """Return the nodes (n, NODES, 3) of fronds from the end of their stem (m)."""
    age = (np.arange(growth.fronds) + 0.5) / growth.fronds
    azimuth = GOLDEN_ANGLE * np.arange(growth.fronds) + rng.normal(0, 0.2, growth.fronds)
    raised = np.radians(np.interp(age, [0, 1], growth.raised_deg[::-1]))
    raised += rng.normal(0, 0.1, growth.fronds)
    share = np.arange(1, NODES + 1) / NODES
    elevation = raised[:, None] - growth.bend * share**1.5 * rng.uniform(0.8, 1.3, (len(age), 1))
    sway = outward(azimuth)[:, None] + 0.08 * rng.normal(0, 1, (len(age), NODES, 3))
    heading = np.cos(elevation)[..., None] * sway + np.sin(elevation)[..., None] * UP
    length = growth.frond_m * rng.uniform(0.75, 1, len(age)) / NODES
    return np.cumsum(length[:, None, None] * unit(heading), axis=1)


STEP_M = 0.45
HOLDS = 4
"""Number of holds of a rope, including its upper end."""


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
    """Return the nodes (k, 3) from one hold (excluded) to the next: a slack rope."""
    span = float(np.linalg.norm(high - low))
    share = np.linspace(0, 1, 2 + int(span / STEP_M))[1:, None]
    slack = 4 * share * (1 - share)
    wave = np.sin(2 * np.pi * share + rng.uniform(0, 2 * np.pi)) * slack
    across = outward(rng.uniform(0, 2 * np.pi, 1))
    return low + share * (high - low) + sag * span * slack * across + 0.06 * wave * across


def grow_axes(species: Species, rng: np.random.Generator) -> Branching:
    """Return the axes of one plant; the stem's foot is at the origin."""
    growth = species.growth
    if isinstance(growth, Colonized):
        return grow_colonized(species, growth, rng)
    if isinstance(growth, Fronded):
        return grow_fronded(species, growth, rng)
    if isinstance(growth, Climbing):
        return grow_climbing(species, growth, rng)
    return grow_whorled(species, growth, rng)
