"""Placed shapes to one mesh per material, with the table that leads from a triangle to its object.

Merging, not instancing: in Mitsuba's vectorized variants every instance is compiled as its own
callable, and a hundred of them already cost seconds per frame.
"""

from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray

from megalopta.scenes.scene import Placement, Scene


@dataclass(frozen=True)
class MergedMesh:
    """All triangles of one material, in world coordinates.

    Attributes
    ----------
    material : str
        Key into `Scene.materials`.
    vertices : (V, 3) float32
        World position, m.
    faces : (F, 3) uint32
        Vertex indices.
    normals : (V, 3) float32 or None
        Shading normals of smooth parts; None where every face is flat.
    uv : (V, 2) float32 or None
        Texture coordinates, for textured materials.
    object_id : (F,) uint32
        Object of each triangle: index into `Scene.placements` plus one.
    """

    material: str
    vertices: NDArray[np.float32]
    faces: NDArray[np.uint32]
    normals: NDArray[np.float32] | None
    uv: NDArray[np.float32] | None
    object_id: NDArray[np.uint32]

    def face_normals(self) -> NDArray[np.float64]:
        """Geometric unit normals (F, 3), as float64."""
        corners = self.vertices.astype(np.float64)[self.faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        return np.asarray(normals / np.maximum(length, 1e-300))


def merge(scene: Scene) -> list[MergedMesh]:
    """One mesh per material and smoothness, in a fixed order."""
    groups: dict[tuple[str, bool], list[tuple[int, Placement, trimesh.Trimesh]]] = {}
    for index, placement in enumerate(scene.placements):
        for material, mesh in scene.assets[placement.asset].parts.items():
            key = material, bool(mesh.metadata.get("smooth"))
            groups.setdefault(key, []).append((index + 1, placement, mesh))
    return [_merge_group(scene, *key, groups[key]) for key in sorted(groups)]


def _merge_group(
    scene: Scene, material: str, smooth: bool, parts: list[tuple[int, Placement, trimesh.Trimesh]]
) -> MergedMesh:
    vertices, faces, normals, uvs, ids = [], [], [], [], []
    definition = scene.materials[material]
    needs_uv = definition.texture is not None or (
        definition.emission is not None and definition.emission.pattern is not None
    )
    offset = 0
    for object_id, placement, mesh in parts:
        rotation = placement.to_world[:3, :3]
        vertices.append(mesh.vertices @ rotation.T + placement.to_world[:3, 3])
        faces.append(np.asarray(mesh.faces) + offset)
        ids.append(np.full(len(mesh.faces), object_id, np.uint32))
        if smooth:
            turned = mesh.vertex_normals @ rotation.T
            normals.append(turned / np.linalg.norm(turned, axis=1, keepdims=True))
        if needs_uv:
            uvs.append(_uv(mesh, material, placement.asset))
        offset += len(mesh.vertices)
    return MergedMesh(
        material,
        np.concatenate(vertices).astype(np.float32),
        np.concatenate(faces).astype(np.uint32),
        np.concatenate(normals).astype(np.float32) if smooth else None,
        np.concatenate(uvs).astype(np.float32) if needs_uv else None,
        np.concatenate(ids),
    )


def _uv(mesh: trimesh.Trimesh, material: str, asset: str) -> NDArray[np.float64]:
    uv = getattr(mesh.visual, "uv", None)
    if uv is None:
        raise ValueError(
            f"asset {asset!r}: material {material!r} is patterned, but its mesh has no uv"
        )
    return np.asarray(uv)
