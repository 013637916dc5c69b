"""Ground truth of one frame from rays through the pixel centers.

A surface point P = o + t·d is found with t from the renderer's own geometry and d in float64; its
flow is where the other camera sees P, minus the pixel center. Points at infinity (the sky) move by
rotation alone. Whether the other camera sees P is decided by a visibility ray, not by comparing
depths, which misjudges more pixels than are truly hidden.

Flow is in px of the stored image, +x right, +y down; NaN where the other camera has no
image of the point, as behind a pinhole. The world is at rest: only the camera moves.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.render import rays
from megalopta.render.merge import MergedMesh
from megalopta.scenes.camera import Camera

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class Truth:
    """What is known exactly about one frame (H, W).

    Attributes
    ----------
    depth : (H, W) float32
        Distance along the optical axis, in panoramas along the ray, m; infinite for the sky.
    normal : (H, W, 3) float32
        Geometric unit normal in world axes, toward the camera; NaN for the sky.
    object_id : (H, W) uint32
        Index into `Scene.placements` plus one; 0 for the sky.
    flow_forward, flow_backward : (H, W, 2) float32
        Displacement (x, y) in px to the next and to the previous frame; NaN where undefined,
        everywhere when there is no such frame.
    occluded_forward, occluded_backward : (H, W) bool
        Whether something stands between the point and the camera of the next or previous frame.
    """

    depth: NDArray[np.float32]
    normal: NDArray[np.float32]
    object_id: NDArray[np.uint32]
    flow_forward: NDArray[np.float32]
    flow_backward: NDArray[np.float32]
    occluded_forward: NDArray[np.bool_]
    occluded_backward: NDArray[np.bool_]


@dataclass(frozen=True)
class TriangleTable:
    """Object id and geometric normal of every triangle, over all meshes in loading order.

    Row 0 stands for "nothing was hit".
    """

    first: NDArray[np.int64]
    object_id: NDArray[np.uint32]
    normal: NDArray[np.float32]

    @classmethod
    def of(cls, meshes: Sequence[MergedMesh]) -> "TriangleTable":
        """Collect the table of merged meshes."""
        sizes = [1, *(len(mesh.faces) for mesh in meshes)]
        normals = [mesh.face_normals().astype(np.float32) for mesh in meshes]
        return cls(
            np.cumsum(sizes),
            np.concatenate([np.zeros(1, np.uint32), *(mesh.object_id for mesh in meshes)]),
            np.concatenate([np.full((1, 3), np.nan, np.float32), *normals]),
        )

    def rows(self, hits: rays.Hits) -> NDArray[np.int64]:
        """Row of each hit; 0 where nothing was hit."""
        hit = np.isfinite(hits.distance)
        rows = np.zeros(len(hit), dtype=np.int64)
        rows[hit] = self.first[hits.mesh[hit]] + hits.triangle[hit]
        return rows


@dataclass(frozen=True)
class SurfacePoints:
    """What the pixel centers see: N directions from one origin, and how far each sees.

    Attributes
    ----------
    origin : (3,)
        Camera position, m.
    directions : (N, 3)
        Unit vectors, world axes.
    distance : (N,)
        Distance to the surface, m; infinite for the sky.
    """

    origin: Float64
    directions: Float64
    distance: Float64

    def seen_from(self, origin: Float64) -> Float64:
        """Vectors (N, 3) from another origin to the points; directions for points at infinity."""
        at_infinity = np.isinf(self.distance)[:, None]
        reach = np.where(at_infinity, 1.0, self.distance[:, None])
        offset = np.where(at_infinity, 0.0, self.origin - origin)
        return np.asarray(offset + reach * self.directions)


def frame_truth(
    scene: Any,
    table: TriangleTable,
    camera: Camera,
    pose: Float64,
    next_pose: Float64 | None,
    previous_pose: Float64 | None,
) -> Truth:
    """Ground truth of the frame seen from `pose`, toward its neighbors' poses (4, 4), if any."""
    shape = camera.height, camera.width
    axes = camera.directions().reshape(-1, 3)
    directions = axes @ pose[:3, :3].T
    hits = rays.nearest_hits(scene, pose[:3, 3], directions)
    points = SurfacePoints(pose[:3, 3], directions, hits.distance)
    rows = table.rows(hits)
    normal = table.normal[rows]
    normal = normal * np.sign(np.einsum("ij,ij->i", normal, -directions))[:, None]

    forward, occluded_forward = _toward(scene, camera, points, next_pose)
    backward, occluded_backward = _toward(scene, camera, points, previous_pose)
    return Truth(
        depth=camera.depth(hits.distance.reshape(shape)).astype(np.float32),
        normal=normal.reshape(*shape, 3).astype(np.float32),
        object_id=table.object_id[rows].reshape(shape),
        flow_forward=forward,
        flow_backward=backward,
        occluded_forward=occluded_forward,
        occluded_backward=occluded_backward,
    )


def out_of_view(flow: NDArray[np.float32], wraps: bool = False) -> NDArray[np.bool_]:
    """Whether a pixel's point (H, W) leaves the image along its flow (H, W, 2), or has no flow.

    An image that wraps around has no left and right edge to leave by.
    """
    height, width = flow.shape[:2]
    x = np.arange(width) + 0.5 + flow[..., 0]
    y = np.arange(height)[:, None] + 0.5 + flow[..., 1]
    inside = np.isfinite(x) if wraps else (x >= 0) & (x <= width)
    return np.asarray(~(inside & (y >= 0) & (y <= height)))


def _toward(
    scene: Any, camera: Camera, points: SurfacePoints, pose: Float64 | None
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    shape = camera.height, camera.width
    if pose is None:
        return np.full((*shape, 2), np.nan, np.float32), np.zeros(shape, bool)
    vectors = points.seen_from(pose[:3, 3])
    flow = camera.displacement((vectors @ pose[:3, :3]).reshape(*shape, 3))
    length = np.linalg.norm(vectors, axis=1)
    distance = np.where(np.isinf(points.distance), np.inf, length)
    hidden = rays.is_hidden(scene, pose[:3, 3], vectors / length[:, None], distance)
    return flow.astype(np.float32), hidden.reshape(shape)
