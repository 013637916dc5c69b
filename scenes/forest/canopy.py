"""Leaf and wood area of a forest: requested and measured.

Leaf-area index is the one-sided area of the leaves of trees, bushes and climbers over the area of
the ground below them. Wood counts with half of its surface, like one of a leaf's two sides (Chen
and Black 1992, Plant, Cell and Environment 15:421). Herbs, grass and litter are excluded, as in the
field, where instruments stand a meter above them.

It applies in a ring around the camera's path: from the clearance of trunks to `RING_M` farther out.
Trees grow with all their leaves, or twice or four times as many on the same twigs, and then lose
some at random; leaves keep their size and clumping.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import griddata
from scipy.spatial import cKDTree

from megalopta.assets_gen import Surface
from megalopta.assets_gen.scatter import distance_to
from megalopta.core.arrays import Floats, Mask
from megalopta.scenes.forest.flora import SMALL, Organs
from megalopta.scenes.forest.planting import dense_path
from megalopta.scenes.scene import Placement, Scene

Specimens = Mapping[str, Organs]

RING_M = 20.0
"""Width of the ring around the path in which the leaf-area index is set and measured (m)."""
FULLNESS = (1, 2, 4)
"""Factors on the number of leaves with which trees can grow."""
SAMPLED = 200
"""Leaves of a specimen sampled for their positions."""
GRID_M = 0.2
"""Grid step for measuring ground area (m)."""


def _is_in(ring_m: tuple[float, float], distance: Floats) -> Mask:
    return np.asarray((distance >= ring_m[0]) & (distance < ring_m[1]))


def ground_area(path: cKDTree, ring_m: tuple[float, float]) -> float:
    """Return the area whose distance from a path is within a ring (m²)."""
    low, high = path.mins - ring_m[1], path.maxes + ring_m[1]
    steps = [np.arange(low[i], high[i], GRID_M) + GRID_M / 2 for i in range(2)]
    distance = distance_to(path, np.stack(np.meshgrid(*steps), axis=-1).reshape(-1, 2))
    return GRID_M**2 * int(_is_in(ring_m, distance).sum())


def in_leaf(
    leaf_area_index: float,
    grow: Callable[[int], Specimens],
    placements: Sequence[Placement],
    path: cKDTree,
    ring_m: tuple[float, float],
) -> tuple[Specimens, float]:
    """Return specimens and the share of leaves to keep for a leaf-area index in a ring of a path.

    Raises ValueError if the stand cannot carry that many leaves.

    `grow`: function that returns all specimens for a factor on their species' leaves.
    """
    ground = ground_area(path, ring_m)
    reached = 0.0
    for fullness in FULLNESS:
        specimens = grow(fullness)
        reached = _leaf_area(specimens, placements, path, ring_m) / ground
        if leaf_area_index <= reached:
            return specimens, leaf_area_index / reached
    raise ValueError(
        f"leaf_area_index: {leaf_area_index:g} is more than the {reached:.2g} that these trees can "
        "carry; raise density_per_ha or lower leaf_area_index"
    )


def _leaf_area(
    specimens: Specimens,
    placements: Sequence[Placement],
    path: cKDTree,
    ring_m: tuple[float, float],
) -> float:
    """Return the area of the leaves of woody plants above a ring around a path (m²)."""
    total = 0.0
    ordered = sorted(placements, key=lambda each: each.asset)
    for name, group in groupby(ordered, lambda each: each.asset):
        members = list(group)
        if name not in specimens or members[0].kind in SMALL:
            continue
        to_world = np.stack([each.to_world for each in members])
        leaves = specimens[name]["leaf"]
        points = _some_places(leaves)
        places = points @ to_world[:, :2, :3].swapaxes(1, 2) + to_world[:, None, :2, 3]
        distance = distance_to(path, places.reshape(-1, 2)).reshape(places.shape[:2])
        inside = _is_in(ring_m, distance).mean(axis=1)
        total += leaves.area * float(inside @ np.cbrt(np.linalg.det(to_world[:, :3, :3])) ** 2)
    return total


def _some_places(leaves: Surface) -> Floats:
    """Return the centers (n, 3) of evenly sampled triangles (m)."""
    faces = leaves.faces[:: max(len(leaves.faces) // SAMPLED, 1)]
    return np.asarray(leaves.vertices[faces].mean(axis=1))


WIDEST_M = 9.0
"""Largest sideways reach of a plant from its foot (m)."""


def _woody_parts(scene: Scene, organ: str) -> list[str]:
    """Names of the materials of an organ of trees and bushes."""
    names = (f"{kind} {organ}" for kind in scene.kinds if kind not in SMALL)
    return [name for name in names if name in scene.materials]


@dataclass(frozen=True)
class PlantArea:
    """Area of trees, bushes and climbers over the area of the ground below."""

    leaf_area_index: float
    """One-sided area of leaves (m²/m²)."""
    wood_area_index: float
    """Half the surface of stems, branches and twigs (m²/m²)."""

    @property
    def wood_share(self) -> float:
        """Wood over total plant area; 0 where nothing grows (1)."""
        whole = self.leaf_area_index + self.wood_area_index
        return self.wood_area_index / whole if whole else 0.0


def plant_area(scene: Scene, path_xy: ArrayLike, ring_m: tuple[float, float]) -> PlantArea:
    """Measure all triangles whose center is above a ring around a path.

    `path_xy` (n, 2): positions of the camera (m); `ring_m`: smallest and largest distance from the
    path (m).
    """
    path = _path(path_xy)
    leaves, barks = (_woody_parts(scene, organ) for organ in ("leaf", "bark"))
    found = dict.fromkeys([*leaves, *barks], 0.0)
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
                found[name] += float(area[_is_in(ring_m, away)].sum())
    ground = ground_area(path, ring_m)
    leaf, wood = (sum(found[name] for name in names) / ground for names in (leaves, barks))
    return PlantArea(leaf, wood / 2)


def floor_points(
    scene: Scene,
    path_xy: ArrayLike,
    ring_m: tuple[float, float],
    height_m: float,
    count: int,
    rng: np.random.Generator,
) -> Floats:
    """Return points (count, 3) at a height above the ground, uniform over a ring around a path (m).

    The ground is the scene's first object.
    """
    path = _path(path_xy)
    low, high = path.mins - ring_m[1], path.maxes + ring_m[1]
    kept = np.empty((0, 2))
    while len(kept) < count:
        thrown = rng.uniform(low, high, (4 * count, 2))
        kept = np.concatenate([kept, thrown[_is_in(ring_m, distance_to(path, thrown))]])
    parts = scene.assets[scene.placements[0].asset].parts.values()
    # Corners between two covers belong to both.
    corners = np.unique(np.concatenate([mesh.vertices for mesh in parts]), axis=0)
    height = griddata(corners[:, :2], corners[:, 2], kept[:count])
    return np.column_stack([kept[:count], height + height_m])


def _path(path_xy: ArrayLike) -> cKDTree:
    return cKDTree(dense_path(np.asarray(path_xy, dtype=float)))
