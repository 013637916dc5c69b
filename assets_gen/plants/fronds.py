"""The axes of palms: a stem that does not branch, and the fronds at its end.

Fronds leave the stem at the golden angle from one to the next, the oldest lowest, and arch over by
their own weight. A frond's leaflets stand in two rows along it.
"""

import numpy as np

from megalopta.assets_gen import FloatArray, unit
from megalopta.assets_gen.plants.branching import GOLDEN_ANGLE, UP, Branching, outward, stem_axis
from megalopta.assets_gen.plants.skeleton import IndexArray, Skeleton
from megalopta.assets_gen.plants.species import Fronded, Species

NODES = 7
"""Internodes of a frond."""
STEM_STEP_M = 0.6
CLUMP_M = 0.5
"""Stems of one plant stand this far from its middle (m)."""


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
