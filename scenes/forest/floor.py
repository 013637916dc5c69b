"""Ground of a forest, and its near floor: a trodden path, moss, bumps, fallen leaves."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from megalopta.assets_gen import FloatArray, Surface, generator, unit
from megalopta.assets_gen.plants.detail import chosen_leaves, corners_of
from megalopta.assets_gen.scatter import distance_to
from megalopta.assets_gen.terrain import Terrain, cut_at, ground_surface, make_moss, make_terrain
from megalopta.assets_gen.tileable_noise import make_octaves
from megalopta.assets_gen.trail import Trail, make_trail
from megalopta.assets_gen.triangulation import Fineness, Triangulation, triangulated
from megalopta.core.arrays import Mask
from megalopta.core.freshness import digest
from megalopta.scenes.forest.flora import LITTER, PLANTS
from megalopta.scenes.forest.planting import planted_reach
from megalopta.scenes.forest.specimens import grow_specimens, store_of
from megalopta.scenes.scene import Asset, Placement

if TYPE_CHECKING:
    from megalopta.scenes.forest.description import Forest

HORIZON_M = 160.0
"""Extent of the ground beyond the stand (m)."""
GROUND_STEP_M, GROUND_NEAR_M = 0.4, 10.0
"""Grid step of the ground's mesh, and the distance from the path up to which it applies (m)."""


def make_land(seed: int, path: cKDTree, relief_m: float, edge_m: float) -> Terrain:
    """Return the land around a path; behind a stand up to a distance (m) it rises by 14 m."""
    rng = generator(seed, "terrain")
    return make_terrain(path, relief_m, (edge_m, edge_m + 26.0), rim_height_m=14.0, rng=rng)


def even_ground(cover: str, land: Terrain, edge_m: float) -> Asset:
    """Return smooth ground of one cover."""
    low, high = land.path.mins - GROUND_NEAR_M, land.path.maxes + GROUND_NEAR_M
    surface = ground_surface(land, low, high, GROUND_STEP_M, edge_m + HORIZON_M)
    return Asset({f"{cover} ground": surface.to_mesh()})


MOSS_RING_M = 10.0
"""Distance from the camera's path within which the share of moss holds (m)."""
BUMPS = (((0.45, 1.3), 0.85), ((0.2, 0.45), 0.47), ((0.11, 0.2), 0.22))
"""Wavelengths of bumps and hollows (m) and their share of the relief."""


@dataclass(frozen=True)
class Floor:
    """Ground mesh, with its covers and litter."""

    mesh: Triangulation
    heights: FloatArray
    """(n,): heights of the mesh's points (m)."""
    uv: FloatArray
    """(n, 2): texture coordinates of the points."""
    covers: Mapping[str, Mask]
    """Mask (m,) of each cover's triangles."""
    leaves: FloatArray
    """(n,): share of litter that remains at the points (1)."""

    def height(self, points: FloatArray) -> FloatArray:
        """Return the height of the mesh (m) at points (n, 2) (m)."""
        return self.mesh.interpolated(self.heights, points)

    def asset(self) -> Asset:
        """Return the ground with a part for each cover; shading hides their borders."""
        vertices = np.column_stack([self.mesh.points, self.heights])
        # Area-weighted means of the adjacent faces.
        a, b, c = vertices[self.mesh.faces].swapaxes(0, 1)
        across = np.cross(b - a, c - a)
        total = np.zeros_like(vertices)
        for corner in range(3):
            for axis in range(3):
                vertex = self.mesh.faces[:, corner]
                total[:, axis] += np.bincount(vertex, across[:, axis], len(vertices))
        normals = unit(total)
        parts = {}
        for cover, chosen in self.covers.items():
            used, faces = np.unique(self.mesh.faces[chosen], return_inverse=True)
            surface = Surface(vertices[used], faces.reshape(-1, 3), self.uv[used], normals[used])
            parts[f"{cover} ground"] = surface.to_mesh()
        return Asset(parts)


def trail_of(forest: "Forest", way: FloatArray, heading: FloatArray) -> Trail | None:
    """Return the trodden path of a forest along the camera's path (n, 2)."""
    if not forest.path_width_m:
        return None
    stand = forest.trees, forest.density_per_ha, forest.clearance_m
    reach_m = planted_reach(*stand) + HORIZON_M
    rng = generator(forest.seed, "trail")
    return make_trail(way, heading, forest.path_width_m, reach_m, rng)


def make_floor(
    forest: "Forest", land: Terrain, trail: Trail | None, trees: FloatArray, edge_m: float
) -> Floor:
    """Return the floor of a forest with trees at (n, 2) and a stand up to a distance (m)."""
    fine = Fineness(finest_m=0.032, near_m=2.5 * float(np.clip(forest.detail, 0.1, 2.0)))
    mesh = triangulated(land.path, fine, edge_m + HORIZON_M, generator(forest.seed, "floor"))
    distance = distance_to(land.path, mesh.points)
    to_centers = distance[mesh.faces].mean(axis=1)
    none = np.zeros(len(mesh.faces), dtype=bool)
    trodden = trail.covers(mesh.centers) if trail else none
    rough = make_octaves(BUMPS, forest.floor_relief_m, generator(forest.seed, "unevenness"))
    bumps = rough(mesh.points, fine.step(distance))
    mossy = none
    if forest.moss_share:
        moss = make_moss(trees, generator(forest.seed, "moss"))
        favor = moss(mesh.centers, fine.step(to_centers))
        near = (to_centers < MOSS_RING_M) & ~trodden
        limit = cut_at(favor, mesh.areas, near, forest.moss_share)
        mossy = (favor > limit) & ~trodden
        thick = np.tanh(np.maximum(moss(mesh.points, fine.step(distance)) - limit, 0))
        bumps += 1.2 * forest.floor_relief_m * thick
    heights = land.height(mesh.points) + bumps
    if trail:
        inside = trail.inside(mesh.points)
        worn = np.clip(inside / 0.25 + 0.5, 0, 1)
        heights -= 0.65 * worn * bumps + trail.sunk(inside)
    covers = {forest.ground: ~(trodden | mossy), "moss patch": mossy, "trodden": trodden}
    shown = {cover: chosen for cover, chosen in covers.items() if chosen.any()}
    leaves = np.ones(len(heights))
    for chosen, share in (mossy, 0.3), (trodden, 0.15):
        leaves[mesh.faces[chosen]] = share
    return Floor(mesh, heights, land.uv(mesh.points), shown, leaves)


FIELDS = {"seed", "detail", "ground", "relief_m", "floor_relief_m", "moss_share", "path_width_m"}
"""Fields of the forest on which its floor depends."""


def kept_floor(
    forest: "Forest", land: Terrain, trail: Trail | None, trees: FloatArray, edge_m: float
) -> Floor:
    """Return the floor from `make_floor`, cached."""
    places = [land.path.data, trees] + ([trail.line.data] if trail else [])
    fields = forest.model_dump_json(include=FIELDS)
    store = store_of("floor", fields, str(edge_m), digest(*(array.tobytes() for array in places)))
    if kept := store.read():
        covers = dict(zip(kept["names"].tolist(), kept["covers"], strict=True))
        mesh = Triangulation(kept["points"], kept["faces"].astype(np.int64))
        return Floor(mesh, kept["heights"], kept["uv"], covers, kept["leaves"])
    floor = make_floor(forest, land, trail, trees, edge_m)
    store.write(
        {
            "points": floor.mesh.points,
            "faces": floor.mesh.faces.astype(np.int32),
            "heights": floor.heights,
            "uv": floor.uv,
            "leaves": floor.leaves,
            "names": np.array([*floor.covers]),
            "covers": np.array([*floor.covers.values()]),
        }
    )
    return floor


def laid(
    seed: int, placements: Sequence[Placement], floor: Floor
) -> tuple[tuple[Placement, ...], dict[str, Asset]]:
    """Return all placements, with an own asset for each piece of litter, and these assets.

    Every corner of a leaf is as high above the mesh as above level ground, but flattened.
    """
    lying = {placement.asset for placement in placements if placement.kind == LITTER}
    specimens = grow_specimens(seed, lying)
    relaid: list[Placement] = []
    assets: dict[str, Asset] = {}
    rng = generator(seed, "litter that stays")
    for index, placement in enumerate(placements):
        if placement.kind != LITTER:
            relaid.append(placement)
            continue
        leaves = specimens[placement.asset]["leaf"]
        linear, foot = placement.to_world[:3, :3], placement.to_world[:3, 3]
        places = leaves.vertices @ linear.T + foot
        middles = places.reshape(-1, corners_of(leaves), 3).mean(axis=1)
        kept = rng.random(len(middles)) < floor.mesh.interpolated(floor.leaves, middles[:, :2])
        above = 0.65 * np.cbrt(np.linalg.det(linear)) * leaves.vertices[:, 2]
        places[:, 2] = floor.height(places[:, :2]) + np.maximum(above, 0.001)
        draped = replace(leaves, vertices=(places - foot) @ np.linalg.inv(linear).T)
        leaves = chosen_leaves(draped, np.flatnonzero(kept))
        if len(leaves.faces):
            name = f"{placement.asset} {index}"
            assets[name] = Asset({PLANTS[LITTER].part("leaf"): leaves.to_mesh()})
            relaid.append(replace(placement, asset=name))
    return tuple(relaid), assets
