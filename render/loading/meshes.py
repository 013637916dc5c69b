"""One mesh per material of all placed shapes, with the table from triangles to objects.

Shapes are merged: in vectorized variants every instance is compiled as its own callable.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Ints
from megalopta.scenes.motion import Motion
from megalopta.scenes.scene import Placement, Scene

if TYPE_CHECKING:
    import trimesh

Float32 = NDArray[np.float32]


@dataclass(frozen=True)
class MovingPart:
    """Range of vertices of one moving object."""

    vertices: slice
    motion: Motion


@dataclass(frozen=True)
class MergedMesh:
    """All triangles of one material, in meters relative to the scene's `origin_m`."""

    material: str
    """Key into `Scene.materials`."""
    vertices: Float32
    """(V, 3): positions, m; for moving objects at time 0."""
    faces: NDArray[np.uint32]
    """(F, 3): vertex indices."""
    normals: Float32 | None
    """(V, 3): shading normals of smooth parts; None if every face is flat."""
    uv: NDArray[np.float32] | None
    """(V, 2): texture coordinates, for textured materials."""
    object_id: NDArray[np.uint32]
    """(F,): object of each triangle: index into `Scene.placements` plus one."""


@dataclass(frozen=True)
class MovingMesh(MergedMesh):
    """Merged mesh of moving objects."""

    placed: Floats
    """(V, 3): world positions of the objects as placed, m."""
    placed_normals: Floats | None
    """(V, 3): shading normals of the objects as placed."""
    parts: tuple[MovingPart, ...]
    """All vertices, in order."""
    origin_m: tuple[float, float, float]
    """(x, y, z): the scene's local origin."""

    def vertices_at(self, time_s: float) -> Float32:
        """Positions (V, 3) at a time, m, relative to the local origin."""
        moved = [part.motion.carry(self.placed[part.vertices], time_s) for part in self.parts]
        return _local(np.concatenate(moved), self.origin_m)

    def some_vertices_at(self, vertex: Ints, times_s: Floats) -> Float32:
        """Positions (n, 3) of some vertices (n,), each at its own time (n,), as `vertices_at`."""
        part_of = np.searchsorted([part.vertices.stop for part in self.parts], vertex, "right")
        order = np.argsort(part_of, kind="stable")
        ends = np.append(np.flatnonzero(np.diff(part_of[order])) + 1, len(order))
        moved = self.placed[vertex]
        for mine in np.split(order, ends[:-1]) if len(order) else []:
            motion = self.parts[part_of[mine[0]]].motion
            moved[mine] = motion.carry(moved[mine], times_s[mine])
        return _local(moved, self.origin_m)

    def normals_at(self, time_s: float) -> Float32 | None:
        """Shading normals (V, 3) at a time; None if every face is flat."""
        if self.placed_normals is None:
            return None
        turned = [
            part.motion.turn(self.placed_normals[part.vertices], self.placed[part.vertices], time_s)
            for part in self.parts
        ]
        return np.concatenate(turned).astype(np.float32)


class _Member(NamedTuple):
    """Mesh as placed in the scene."""

    object_id: int
    placement: Placement
    mesh: "trimesh.Trimesh"

    def vertices(self) -> Floats:
        to_world = self.placement.to_world
        return np.asarray(self.mesh.vertices @ to_world[:3, :3].T + to_world[:3, 3])

    def normals(self) -> Floats:
        turned = self.mesh.vertex_normals @ self.placement.to_world[:3, :3].T
        return np.asarray(turned / np.linalg.norm(turned, axis=1, keepdims=True))

    def uv(self, material: str, is_leaf: bool) -> Floats:
        uv = getattr(self.mesh.visual, "uv", None)
        if uv is None:
            raise ValueError(
                f"asset {self.placement.asset!r}: material {material!r} is patterned, but its mesh "
                "has no uv"
            )
        return np.asarray(uv + np.array([0.0, self.placement.leaf_shift * is_leaf]))


def merge(scene: Scene) -> list[MergedMesh]:
    """One mesh per material, smoothness and state of motion; those at rest come first."""
    return [_merge_group(scene, *key, members) for key, members in _groups(scene)]


def leaf_clusters(scene: Scene) -> NDArray[np.uint32]:
    """Number of the twig in its plant, for each triangle of the merged meshes in order, (F + 1,).

    It is 0 for all that is no leaf of a twig, and for the last, the sky.
    """
    parts = [
        piece.mesh.metadata.get("clusters", np.zeros(len(piece.mesh.faces)))
        for _, members in _groups(scene)
        for piece in members
    ]
    return np.concatenate([*parts, np.zeros(1)]).astype(np.uint32)


def _groups(scene: Scene) -> list[tuple[tuple[bool, str, bool], list[_Member]]]:
    groups: dict[tuple[bool, str, bool], list[_Member]] = {}
    for index, placement in enumerate(scene.placements):
        for material, mesh in scene.assets[placement.asset].parts.items():
            key = placement.motion is not None, material, bool(mesh.metadata.get("smooth"))
            groups.setdefault(key, []).append(_Member(index + 1, placement, mesh))
    return [(key, groups[key]) for key in sorted(groups)]


def _merge_group(
    scene: Scene, moves: bool, material: str, smooth: bool, members: list[_Member]
) -> MergedMesh:
    offsets = np.cumsum([0, *(len(part.mesh.vertices) for part in members)]).tolist()
    faces = [
        np.asarray(part.mesh.faces) + offset for part, offset in zip(members, offsets, strict=False)
    ]
    placed = np.concatenate([part.vertices() for part in members])
    normals = np.concatenate([part.normals() for part in members]) if smooth else None
    look = scene.materials[material]
    glows = look.emission is not None and look.emission.pattern is not None
    patterned = look.finish.is_patterned if look.finish else look.texture is not None or glows
    coordinates = [part.uv(material, look.transmits) for part in members] if patterned else None
    uv = None if coordinates is None else np.concatenate(coordinates).astype(np.float32)
    ids = [np.full(len(part.mesh.faces), part.object_id, np.uint32) for part in members]
    merged = MergedMesh(
        material,
        _local(placed, scene.origin_m),
        np.concatenate(faces).astype(np.uint32),
        None if normals is None else normals.astype(np.float32),
        uv,
        np.concatenate(ids),
    )
    if not moves:
        return merged
    parts = tuple(
        MovingPart(slice(*span), part.placement.motion)
        for span, part in zip(pairwise(offsets), members, strict=True)
        if part.placement.motion is not None
    )
    moving = MovingMesh(
        **vars(merged), placed=placed, placed_normals=normals, parts=parts, origin_m=scene.origin_m
    )
    return replace(moving, vertices=moving.vertices_at(0.0), normals=moving.normals_at(0.0))


def _local(points: Floats, origin_m: tuple[float, float, float]) -> Float32:
    return np.asarray(points - np.asarray(origin_m), dtype=np.float32)
