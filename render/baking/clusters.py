"""Cells that share their light: in clusters, and clusters with their neighbors.

In foliage a pixel sees dozens of leaves at a time, each once in a sequence: only their mean
matters. Cells of one material, of similar orientation and in the same voxel, a quarter to half a
pixel wide where the camera comes closest, form a cluster. Its light is gathered at points drawn in
proportion to how often the sequence sees their cells.

Neighboring clusters are distinguished only as far as their light differs by more than its noise. In
a voxel some pixels wide, the light of clusters of the same orientation varies by τ², and each
estimate by its noise v. The part τ²/(τ² + v) of a cluster's deviation from their mean is kept,
which minimizes the mean square error (James and Stein, 1961). Half differences then represent the
whole error, including lost contrast.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from megalopta.core.arrays import Floats, Ints
from megalopta.render.baking.cells import NEAREST_M, Cells, UInt32, pixel_angle
from megalopta.render.loading.meshes import MergedMesh
from megalopta.scenes.cameras.base import Camera

VOXEL_PX = 0.5
"""Widest voxel, in pixels of the camera at its closest."""
DRAWS = 32
"""Cells per cluster at which light is gathered."""
# Odd constants of the hash: golden ratio, and that of the xxHash algorithm.
_MULTIPLIERS = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F], np.uint64)


class Voxels:
    """Voxels of the cells of meshes, for a camera at positions (T, 3)."""

    def __init__(
        self,
        cells: Cells,
        meshes: Sequence[MergedMesh],
        camera: Camera,
        positions: Floats,
    ) -> None:
        self._cells, self._meshes = cells, meshes
        self._path, self._pixel_rad = cKDTree(positions), pixel_angle(camera)

    def keys(self, cell: UInt32, octaves: int = 0) -> NDArray[np.uint64]:
        """Hash (C,) that cells (C,) of one cluster share; each octave doubles the voxel size."""
        patches = self._cells.patches(cell)
        corners = np.empty((len(cell), 3, 3))
        for index in np.unique(patches.mesh):
            here, mesh = patches.mesh == index, self._meshes[index]
            corners[here] = mesh.vertices[mesh.faces[patches.triangle[here]]]
        rows = np.arange(len(cell))
        a, b, c = (corners[rows, (patches.origin + step) % 3] for step in range(3))
        u, v = (patches.indices + 0.5) / patches.pieces
        total = np.maximum(u + v, 1)
        center = a + (u / total)[:, None] * (b - a) + (v / total)[:, None] * (c - a)
        normal = np.cross(b - a, c - a) * np.where(patches.side == 0, 1, -1)[:, None]
        axis = np.abs(normal).argmax(axis=1)
        facing = 2 * axis + (normal[rows, axis] > 0)
        size = self._pixel_rad * np.maximum(self._path.query(center)[0], NEAREST_M)
        level = np.floor(np.log2(VOXEL_PX * size)) + octaves
        voxel = np.floor(center / np.exp2(level)[:, None])
        return _hashed([patches.mesh, level, facing, *voxel.T])


@dataclass(frozen=True)
class Clusters:
    """Cells in C clusters, sorted by cluster."""

    members: UInt32
    first: Ints
    """(C + 1,): index of the first member of each cluster, and the number of members."""
    weight: Ints
    """Cumulative number of times that members were seen, from 1 on."""
    places: UInt32
    """Place where each member was seen once."""

    @classmethod
    def of(cls, cell: UInt32, keys: NDArray[np.uint64], seen: UInt32, places: UInt32) -> "Clusters":
        """Cluster cells (N,) by their keys; `seen` is the number of times each was seen."""
        order = np.argsort(keys, kind="stable")
        ends = np.flatnonzero(np.diff(keys[order])) + 1
        first = np.concatenate([[0], ends, [len(cell)]]) if len(cell) else np.zeros(1)
        weight = np.cumsum(seen[order], dtype=np.int64)
        return cls(cell[order], first.astype(np.int64), weight, places[order])

    def __len__(self) -> int:
        return len(self.first) - 1

    @property
    def leaders(self) -> UInt32:
        """(C,): first member of each cluster."""
        return self.members[self.first[:-1]]

    @property
    def seen(self) -> Ints:
        """(C,): number of times that members were seen."""
        return np.diff(np.concatenate([[0], self.weight])[self.first])

    def draws(self, chosen: Ints) -> tuple[UInt32, UInt32]:
        """Members (C, DRAWS) of chosen clusters (C,), in proportion to how often each was seen.

        Also the place where each was seen once.
        """
        before = np.concatenate([[0], self.weight])[self.first[chosen]]
        steps = (np.arange(DRAWS) + 0.5) / DRAWS
        weight = before[:, None] + steps * self.seen[chosen][:, None]
        drawn = np.searchsorted(self.weight, weight, side="right")
        return self.members[drawn], self.places[drawn]


def _hashed(columns: Sequence[NDArray[np.generic]]) -> NDArray[np.uint64]:
    """Hash (N,) of integers in columns (N,)."""
    found = np.zeros(len(columns[0]), np.uint64)
    for column in columns:
        found ^= column.astype(np.int64).astype(np.uint64)
        for multiplier in _MULTIPLIERS:
            found *= multiplier
            found ^= found >> np.uint64(29)
    return found


def smoothed(
    rows: NDArray[np.floating], neighbors: NDArray[np.uint64], rays: Ints, seen: Ints
) -> NDArray[np.floating]:
    """Smoothed rows (C, 2·n) of clusters: n values, and half the differences of their two halves.

    Clusters with equal numbers are neighbors; `rays` of each give its precision.
    """
    _, group = np.unique(neighbors, return_inverse=True)
    n = rows.shape[1] // 2
    light, apart = (rows[:, half].sum(axis=1, dtype=np.float64) for half in np.s_[:n, n:])

    def total(values: Floats) -> Floats:
        return np.asarray(np.bincount(group, values), np.float64)

    count, weight = total(np.ones(len(rows))), total(rays.astype(float))
    # For one ray: the difference of halves has the variance of the mean.
    of_a_ray = total(rays * apart**2) / count
    mean = total(rays * light) / weight
    noise = of_a_ray[group] / rays
    # Weighted by how often pixels show them: visible contrast matters.
    shown = total(seen.astype(float))
    spread = total(seen * ((light - mean[group]) ** 2 - noise * (1 - rays / weight[group]))) / shown
    contrast = np.maximum(spread * count / np.maximum(count - 1, 1), 0)[group]
    kept = np.where(contrast + noise > 0, contrast / np.maximum(contrast + noise, 1e-300), 1.0)
    kept = np.where(count[group] > 1, kept, 1.0)
    # The minimum mean square error is v·kept: the part of the noise that is kept, and of the
    # contrast that is lost. Half differences should have this error.
    found = np.empty_like(rows)
    for column, values in enumerate(rows.T):  # one by one: rows are large
        level = (total(rays * values) / weight)[group]
        found[:, column] = level + (kept if column < n else np.sqrt(kept)) * (values - level)
    return found
