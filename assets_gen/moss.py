"""Where moss grows: patches with outlines of many sizes, around the feet of trees rather than not.

A random field with waves from centimeters to meters is cut at the height that leaves the share
asked for above it. Its finer waves fray the outline down to the mesh.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from megalopta.assets_gen import FloatArray
from megalopta.assets_gen.scatter import distance_to
from megalopta.assets_gen.tileable_noise import Octaves, make_octaves

BANDS = (((1.2, 5.0), 0.8), ((0.3, 1.2), 0.5), ((0.09, 0.3), 0.33))
"""Wavelengths (m) and contrast of patches, of their outline, of its fringe."""
AT_TREES, AROUND_M = 1.4, 0.7
"""How much likelier moss is at the foot of a tree, in units of the contrast, and how far (m)."""


@dataclass(frozen=True)
class Moss:
    """How favorable the ground is to moss, from place to place."""

    patches: Octaves
    trees: cKDTree
    """Where trees stand (m)."""

    def favor(self, points: FloatArray, step_m: FloatArray) -> FloatArray:
        """Return the field (n,) at points (n, 2) of a mesh with steps (n,) (m)."""
        near = AT_TREES * np.exp(-((distance_to(self.trees, points) / AROUND_M) ** 2))
        return near + self.patches(points, step_m)


def make_moss(trees: FloatArray, rng: np.random.Generator) -> Moss:
    """Return a random field of variance 1 around trees (n, 2) (m)."""
    return Moss(make_octaves(BANDS, 1.0, rng), cKDTree(trees))


def cut_at(favor: FloatArray, areas: FloatArray, where: NDArray[np.bool_], share: float) -> float:
    """Return the value of a field (m,) above which lies a share of some triangles' areas (m,)."""
    values = favor[where]
    order = np.argsort(-values)
    covered = np.cumsum(areas[where][order])
    last = int(np.searchsorted(covered, share * covered[-1]))
    return float(values[order[min(last, len(order) - 1)]])
