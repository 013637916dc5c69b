"""Ground as a height field: level at the camera's path, rolling beyond, a rim around the stand.

Moss grows preferably around the feet of trees: a random field is thresholded at its share.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from megalopta.assets_gen import FloatArray, Surface, grid_faces, unit
from megalopta.assets_gen.scatter import distance_to
from megalopta.assets_gen.tileable_noise import PlaneWaves, Rough, make_octaves, plane_waves

GROUND_TILE_M = 5.0
"""Size of one tile of the ground's texture (m)."""


@dataclass(frozen=True)
class Terrain:
    """Height of the ground: 0, to a few centimeters, along the camera's path.

    The land is level up to 3 m from the path, and rolls freely from 14 m on. Its height is exactly
    0 at the world's origin if the path passes within 3 m of it.
    """

    path: cKDTree
    """Points of the camera's path in the plane (m), one every meter or closer."""
    hills: PlaneWaves
    bumps: PlaneWaves
    """Rolling land and unevenness underfoot (m)."""
    crest: PlaneWaves
    """Unevenness of the rim, relative to its height."""
    drift: tuple[PlaneWaves, PlaneWaves]
    """Slow distortion of the texture in u and v (tiles)."""
    rim_m: tuple[float, float]
    """Distances from the path between which the land rises (m)."""
    rim_height_m: float
    """Mean height of the rim (m)."""

    def height(self, points: FloatArray) -> FloatArray:
        """Return the height of the ground (m) at points (n, 2) (m)."""
        distance = distance_to(self.path, points)
        rolling = _smooth_step(distance, 3.0, 14.0) * self.hills(points)
        rim = self.rim_height_m * (1 + self.crest(points)) * _smooth_step(distance, *self.rim_m)
        return rolling + rim + self.bumps(points) - self.bumps(np.zeros(2))

    def uv(self, points: FloatArray) -> FloatArray:
        """Return texture coordinates at points (n, 2) (m); tiles are slightly distorted."""
        return points / GROUND_TILE_M + np.stack([wave(points) for wave in self.drift], axis=-1)


def _smooth_step(x: FloatArray, start: float, end: float) -> FloatArray:
    share = np.clip((x - start) / (end - start), 0, 1)
    return share**2 * (3 - 2 * share)


def make_terrain(
    path: cKDTree,
    relief_m: float,
    rim_m: tuple[float, float],
    rim_height_m: float,
    rng: np.random.Generator,
) -> Terrain:
    """Return random terrain; `relief_m` is the root mean square height of the rolling land."""
    return Terrain(
        path,
        hills=plane_waves((14.0, 60.0), relief_m, 24, rng),
        bumps=plane_waves((0.9, 5.0), 0.035, 32, rng),
        crest=plane_waves((30.0, 80.0), 0.35, 16, rng),
        drift=(plane_waves((15.0, 40.0), 0.12, 12, rng), plane_waves((15.0, 40.0), 0.12, 12, rng)),
        rim_m=rim_m,
        rim_height_m=rim_height_m,
    )


def ground_surface(
    terrain: Terrain, low: FloatArray, high: FloatArray, step_m: float, reach_m: float
) -> Surface:
    """Return the ground as a grid, with uniform steps of `step_m` between two corners (2,) (m).

    It extends for `reach_m` beyond them, with growing steps.
    """
    away = np.cumsum(step_m * 1.15 ** np.arange(1, 200))
    beyond = away[: np.searchsorted(away, reach_m) + 1]
    x, y = (
        np.concatenate([start - beyond[::-1], np.linspace(start, end, steps), end + beyond])
        for start, end in zip(low, high, strict=True)
        for steps in [max(int((end - start) / step_m), 2)]
    )
    flat = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    grid = np.column_stack([flat, terrain.height(flat)]).reshape(len(y), len(x), 3)
    rows, columns = np.gradient(grid, axis=(0, 1))
    normals = unit(np.cross(columns, rows)).reshape(-1, 3)
    return Surface(grid.reshape(-1, 3), grid_faces(len(y), len(x)), terrain.uv(flat), normals)


MOSS_BANDS = (((1.2, 5.0), 0.8), ((0.3, 1.2), 0.5), ((0.09, 0.3), 0.33))
"""Wavelengths (m) and contrast of moss patches, of their outline, and of its fringe."""


def make_moss(trees: FloatArray, rng: np.random.Generator) -> Rough:
    """Return how favorable the ground is to moss: variance 1, and more around trees (n, 2) (m)."""
    patches, feet = make_octaves(MOSS_BANDS, 1.0, rng), cKDTree(trees)

    def favor(points: FloatArray, step_m: FloatArray) -> FloatArray:
        near = 1.4 * np.exp(-((distance_to(feet, points) / 0.7) ** 2))
        return near + patches(points, step_m)

    return favor


def cut_at(favor: FloatArray, areas: FloatArray, where: NDArray[np.bool_], share: float) -> float:
    """Return the threshold of a field (m,) above which a share of the triangles' areas (m,) is."""
    values = favor[where]
    order = np.argsort(-values)
    covered = np.cumsum(areas[where][order])
    last = int(np.searchsorted(covered, share * covered[-1]))
    return float(values[order[min(last, len(order) - 1)]])
