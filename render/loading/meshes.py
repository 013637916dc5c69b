"""Placed shapes to one mesh per material, with the table that leads from a triangle to its object.

Merging, not instancing: in Mitsuba's vectorized variants every instance is compiled as its own
callable, and a hundred of them already cost seconds per frame.

What moves has meshes of its own, after those at rest, whose vertices follow from the time.
"""

from dataclasses import dataclass, replace

import numpy as np
import trimesh
from numpy.typing import NDArray

from megalopta.scenes.world import Motion, Placement, Scene

Float32 = NDArray[np.float32]


@dataclass(frozen=True)
class MovingPart:
    """A run of vertices that belong to one moving object."""

    vertices: slice
    motion: Motion


@dataclass(frozen=True)
class MergedMesh:
    """All triangles of one material, in meters relative to the scene's `origin_m`."""

    material: str
    """Key into `Scene.materials`."""
    vertices: Float32
    """(V, 3): positions, m; of moving objects at time 0."""
    faces: NDArray[np.uint32]
    """(F, 3): vertex indices."""
    normals: Float32 | None
    """(V, 3): shading normals of smooth parts; None where every face is flat."""
    uv: NDArray[np.float32] | None
    """(V, 2): texture coordinates, for textured materials."""
    object_id: NDArray[np.uint32]
    """(F,): object of each triangle: index into `Scene.placements` plus one."""


@dataclass(frozen=True)
class MovingMesh(MergedMesh):
    """A merged mesh of objects that move."""

    placed: NDArray[np.float64]
    """(V, 3): world positions of the objects as placed, m."""
    placed_normals: NDArray[np.float64] | None
    """(V, 3): shading normals of the objects as placed."""
    parts: tuple[MovingPart, ...]
    """All vertices, in order."""
    origin_m: tuple[float, float, float]
    """(x, y, z): the scene's local origin."""

    def vertices_at(self, time_s: float) -> Float32:
        """Positions (V, 3) at a time, m, relative to the local origin."""
        moved = [part.motion.carry(self.placed[part.vertices], time_s) for part in self.parts]
        return _local(np.concatenate(moved), self.origin_m)

    def normals_at(self, time_s: float) -> Float32 | None:
        """Shading normals (V, 3) at a time; None where every face is flat."""
        if self.placed_normals is None:
            return None
        turned = [
            part.motion.turn(self.placed_normals[part.vertices], self.placed[part.vertices], time_s)
            for part in self.parts
        ]
        return np.concatenate(turned).astype(np.float32)


def merge(scene: Scene) -> list[MergedMesh]:
    """One mesh per material, smoothness and whether it moves; those at rest come first."""
    groups: dict[tuple[bool, str, bool], list[tuple[int, Placement, trimesh.Trimesh]]] = {}
    for index, placement in enumerate(scene.placements):
        for material, mesh in scene.assets[placement.asset].parts.items():
            moves = placement.motion is not None
            key = moves, material, bool(mesh.metadata.get("smooth"))
            groups.setdefault(key, []).append((index + 1, placement, mesh))
    return [_merge_group(scene, *key, groups[key]) for key in sorted(groups)]


def _merge_group(
    scene: Scene,
    moves: bool,
    material: str,
    smooth: bool,
    members: list[tuple[int, Placement, trimesh.Trimesh]],
) -> MergedMesh:
    vertices, faces, normals, uvs, ids, parts = [], [], [], [], [], []
    definition = scene.materials[material]
    needs_uv = definition.texture is not None or (
        definition.emission is not None and definition.emission.pattern is not None
    )
    offset = 0
    for object_id, placement, mesh in members:
        rotation = placement.to_world[:3, :3]
        vertices.append(mesh.vertices @ rotation.T + placement.to_world[:3, 3])
        faces.append(np.asarray(mesh.faces) + offset)
        ids.append(np.full(len(mesh.faces), object_id, np.uint32))
        if smooth:
            turned = mesh.vertex_normals @ rotation.T
            normals.append(turned / np.linalg.norm(turned, axis=1, keepdims=True))
        if needs_uv:
            uvs.append(_uv(mesh, material, placement.asset))
        following = offset + len(mesh.vertices)
        if placement.motion is not None:
            parts.append(MovingPart(slice(offset, following), placement.motion))
        offset = following
    placed = np.concatenate(vertices)
    placed_normals = np.concatenate(normals) if smooth else None
    merged = MergedMesh(
        material,
        _local(placed, scene.origin_m),
        np.concatenate(faces).astype(np.uint32),
        None if placed_normals is None else placed_normals.astype(np.float32),
        np.concatenate(uvs).astype(np.float32) if needs_uv else None,
        np.concatenate(ids),
    )
    if not moves:
        return merged
    moving = MovingMesh(
        **vars(merged),
        placed=placed,
        placed_normals=placed_normals,
        parts=tuple(parts),
        origin_m=scene.origin_m,
    )
    return replace(moving, vertices=moving.vertices_at(0.0), normals=moving.normals_at(0.0))


def _local(points: NDArray[np.float64], origin_m: tuple[float, float, float]) -> Float32:
    return np.asarray(points - np.asarray(origin_m), dtype=np.float32)


def _uv(mesh: trimesh.Trimesh, material: str, asset: str) -> NDArray[np.float64]:
    uv = getattr(mesh.visual, "uv", None)
    if uv is None:
        raise ValueError(
            f"asset {asset!r}: material {material!r} is patterned, but its mesh has no uv"
        )
    return np.asarray(uv)
