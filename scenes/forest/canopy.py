"""How much leaf and wood a forest holds, measured on its triangles.

Leaf area is one-sided. Wood counts with half of its surface, as a leaf with one of its two sides
(Chen and Black 1992, Plant, Cell and Environment 15:421). Herbs, grass and what lies on the ground
count as neither, as in the field, where instruments stand a meter above them.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import griddata
from scipy.spatial import cKDTree

from megalopta.assets_gen.scatter import distance_to
from megalopta.scenes.forest.leaf_area import ground_area
from megalopta.scenes.forest.planting import dense_path
from megalopta.scenes.forest.plants import Woody
from megalopta.scenes.forest.undergrowth import PLANTS
from megalopta.scenes.scene import Scene

Float64 = NDArray[np.float64]

WIDEST_M = 9.0
"""No plant reaches farther sideways from its foot than this (m)."""
_LEAVES, _WOOD = (
    frozenset(plant.part(organ) for plant in PLANTS.values() if isinstance(plant, Woody))
    for organ in ("leaf", "bark")
)


@dataclass(frozen=True)
class PlantArea:
    """Area of trees, bushes and climbers over the area of the ground below."""

    leaf_area_index: float
    """One-sided area of leaves (m²/m²)."""
    wood_area_index: float
    """Half the surface of stems, branches and twigs (m²/m²)."""

    @property
    def wood_share(self) -> float:
        """Wood over all plant area, 0 where nothing grows (1)."""
        whole = self.leaf_area_index + self.wood_area_index
        return self.wood_area_index / whole if whole else 0.0


def plant_area(scene: Scene, path_xy: ArrayLike, ring_m: tuple[float, float]) -> PlantArea:
    """Measure all triangles whose middle is above a ring around a path.

    Parameters
    ----------
    path_xy : (n, 2)
        Positions of the camera (m).
    ring_m
        Least and largest distance from the path (m).
    """
    path = _path(path_xy)
    found = dict.fromkeys(_LEAVES | _WOOD, 0.0)
    feet = np.array([each.to_world[:2, 3] for each in scene.placements])
    near = distance_to(path, feet) < ring_m[1] + WIDEST_M
    for index in np.flatnonzero(near).tolist():
        placement = scene.placements[index]
        for name, mesh in scene.assets[placement.asset].parts.items():
            if name in found:
                triangles = mesh.vertices[mesh.faces] @ placement.to_world[:3, :3].T
                a, b, c = triangles.swapaxes(0, 1)
                area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
                away = distance_to(path, (a + b + c)[:, :2] / 3 + placement.to_world[:2, 3])
                found[name] += float(area[(away >= ring_m[0]) & (away < ring_m[1])].sum())
    ground = ground_area(path, ring_m)
    leaf, wood = (sum(found[name] for name in names) / ground for names in (_LEAVES, _WOOD))
    return PlantArea(leaf, wood / 2)


def floor_points(
    scene: Scene,
    path_xy: ArrayLike,
    ring_m: tuple[float, float],
    height_m: float,
    count: int,
    rng: np.random.Generator,
) -> Float64:
    """Return points (count, 3) at a height above the ground, evenly over a ring around a path (m).

    The ground is the scene's first object.
    """
    path = _path(path_xy)
    low, high = path.mins - ring_m[1], path.maxes + ring_m[1]
    kept = np.empty((0, 2))
    while len(kept) < count:
        thrown = rng.uniform(low, high, (4 * count, 2))
        away = distance_to(path, thrown)
        kept = np.concatenate([kept, thrown[(away >= ring_m[0]) & (away < ring_m[1])]])
    parts = scene.assets[scene.placements[0].asset].parts.values()
    # Corners where two covers meet belong to both.
    corners = np.unique(np.concatenate([mesh.vertices for mesh in parts]), axis=0)
    height = griddata(corners[:, :2], corners[:, 2], kept[:count])
    return np.column_stack([kept[:count], height + height_m])


def _path(path_xy: ArrayLike) -> cKDTree:
    return cKDTree(dense_path(np.asarray(path_xy, dtype=float)))
