"""Triangulated plane, finer along a path: a jittered lattice in each ring of distances from it.

Delaunay triangles have no T-junctions between levels, and no straight lines along their edges.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import Delaunay, cKDTree

from megalopta.assets_gen import FloatArray
from megalopta.assets_gen.scatter import distance_to

JITTER = 0.35
"""Largest displacement of a point from its lattice position, in steps."""
TILE_STEPS = 32
"""Size, in lattice steps, of the squares that are kept or omitted as a whole."""
NEAREST = 6, 48
"""Candidate triangles around a place, at the first and at the second attempt."""


@dataclass(frozen=True)
class Fineness:
    """Step of the triangulation by distance from a path."""

    finest_m: float
    """Step up to `near_m` from the path (m)."""
    near_m: float
    """Distance beyond which steps grow in proportion to it (m)."""

    def step(self, distance_m: ArrayLike) -> FloatArray:
        """Step at distances from the path (m)."""
        return self.finest_m * np.maximum(np.asarray(distance_m) / self.near_m, 1)


@dataclass(frozen=True)
class Triangulation:
    """Points of the plane with the triangles between them."""

    points: FloatArray
    """(n, 2): meters."""
    faces: NDArray[np.int64]
    """(m, 3): counterclockwise."""

    @cached_property
    def areas(self) -> FloatArray:
        """Area (m,) of the triangles (m²)."""
        a, b, c = self.points[self.faces].swapaxes(0, 1)
        return _area(b - a, c - a)

    @cached_property
    def centers(self) -> FloatArray:
        """Centers (m, 2) of the triangles (m)."""
        return np.asarray(self.points[self.faces].mean(axis=1))

    @cached_property
    def _near(self) -> cKDTree:
        return cKDTree(self.centers)

    def interpolated(self, values: FloatArray, places: FloatArray) -> FloatArray:
        """Return values (n,) of the points at places (k, 2), linear within each triangle.

        Raises ValueError for places outside.
        """
        interpolated = np.empty(len(places))
        left = np.arange(len(places))
        for nearest in NEAREST:
            faces = self.faces[self._near.query(places[left], k=nearest)[1]]
            # weights of the corners of each candidate, barycentric
            edges = self.points[faces] - places[left][:, None, None]
            parts = [_area(edges[..., i - 2, :], edges[..., i - 1, :]) for i in range(3)]
            weights = np.stack(parts, axis=-1)
            weights = weights / weights.sum(axis=-1, keepdims=True)
            worst = weights.min(axis=-1)
            best = worst.argmax(axis=-1)
            rows = np.arange(len(left))
            inside = worst[rows, best] > -1e-9
            value = np.einsum("ki,ki->k", weights[rows, best], values[faces[rows, best]])
            interpolated[left[inside]] = value[inside]
            left = left[~inside]
            if not len(left):
                return interpolated
        raise ValueError(f"places: {len(left)} are outside the triangles; give others")


def _area(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the signed area (…) of triangles with two edges (…, 2)."""
    return np.asarray(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]) / 2


def triangulated(
    path: cKDTree, fineness: Fineness, reach_m: float, rng: np.random.Generator
) -> Triangulation:
    """Return the plane up to a distance from a path (m), in triangles."""
    rings = [0.0, fineness.near_m]
    while rings[-1] < reach_m:
        rings.append(rings[-1] * np.sqrt(2.0))
    inner = np.stack(np.meshgrid(*[np.arange(TILE_STEPS) + 0.5] * 2), axis=-1).reshape(-1, 2)
    lattices = []
    for near, far in pairwise(rings):
        step_m, far_m = float(fineness.step(np.sqrt(near * far))), min(far, reach_m)
        tile = TILE_STEPS * step_m
        low, high = np.floor((path.mins - far_m) / tile), np.ceil((path.maxes + far_m) / tile)
        corners = np.stack(
            np.meshgrid(*(np.arange(low[i], high[i]) for i in range(2))), axis=-1
        ).reshape(-1, 2)
        away = distance_to(path, (corners + 0.5) * tile)
        corners = corners[(away < far_m + tile) & (away > near - tile)]
        lattice = ((corners * TILE_STEPS)[:, None] + inner).reshape(-1, 2)
        jittered = (lattice + rng.uniform(-JITTER, JITTER, lattice.shape)) * step_m
        distance = distance_to(path, jittered)
        lattices.append(jittered[(distance >= near) & (distance < far_m)])
    points = np.concatenate(lattices)
    # Relative to the path, for precision anywhere.
    faces = Delaunay(points - (path.mins + path.maxes) / 2).simplices.astype(np.int64)
    a, b, c = points[faces].swapaxes(0, 1)
    turned = _area(b - a, c - a) < 0
    faces[turned] = faces[turned][:, ::-1]
    return Triangulation(points, faces)
