"""Rows of a rolling shutter that share one pose of moving objects.

Moving a scene to another pose takes as long as at least some 10⁵ light paths. Rows share a pose if
nothing visible moves by more than `SHARED_PX` between them: moving objects are then less than half
of that from their position at the row's time. This is determined for each frame, from all moving
triangles that are visible in its first, middle or last row, between moments at most `_STEP_S`
apart; `_RESERVE` covers motion between these.

A shadow moves as far as its object, in meters: it may move by more in px where it falls nearer.
"""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Mask
from megalopta.render.loading.meshes import MovingMesh
from megalopta.scenes.cameras.base import Camera

SHARED_PX = 0.05
_STEP_S, _FEWEST_STEPS, _MOST_STEPS = 0.01, 2, 64
_RESERVE = 1.25
_MARGIN = 0.1
"""Margin around the image, in image widths, for objects that enter meanwhile."""


def rows_of_a_pose(
    meshes: Sequence[MovingMesh], camera: Camera, pose: Floats, times_s: Sequence[float]
) -> int:
    """Return the number of rows that may share a pose, for a frame with row times (H,), s.

    The pose (4, 4) of the camera, relative to the scene's origin, is that of the middle row.
    """
    start, end, height = times_s[0], times_s[-1], len(times_s)
    steps = min(max(math.ceil((end - start) / _STEP_S), _FEWEST_STEPS), _MOST_STEPS)
    moments = np.linspace(start, end, steps + 1)
    farthest = max(_farthest(mesh, camera, pose, moments) for mesh in meshes)
    whole = _RESERVE * farthest * steps
    if whole <= SHARED_PX:
        return height
    most = math.floor(SHARED_PX / whole * max(height - 1, 1)) + 1
    return math.ceil(height / _round_number(math.ceil(height / most)))


def _farthest(mesh: MovingMesh, camera: Camera, pose: Floats, moments: Floats) -> float:
    """Longest displacement in the image, px, of a visible triangle from one moment to the next."""
    seen = np.zeros(len(mesh.faces), bool)
    for time in moments[[0, len(moments) // 2, -1]].tolist():
        seen |= _seen(mesh.faces, camera, _from_camera(mesh.vertices_at(time), pose))
    vertex, corner = np.unique(mesh.faces[seen].astype(np.int64), return_inverse=True)
    corner = corner.reshape(-1, 3)
    each = [
        _from_camera(mesh.some_vertices_at(vertex, np.full(len(vertex), time)), pose)
        for time in moments
    ]
    return max(_longest(camera, a[corner], b[corner]) for a, b in pairwise(each))


def _from_camera(vertices: NDArray[np.float32], pose: Floats) -> Floats:
    """Vectors (n, 3) from the camera to vertices (n, 3) in camera axes."""
    ways: Floats = np.einsum("ji,nj->ni", pose[:3, :3], vertices - pose[:3, 3])
    return ways


def _seen(faces: NDArray[np.uint32], camera: Camera, ways: Floats) -> Mask:
    """True for triangles (F,) that may be visible in the image or the margin around it."""
    if camera.intrinsics is None:
        x, y, depth = *camera.project(ways).T, np.ones(len(ways))
    else:
        x, y, depth = np.einsum("ij,nj->in", camera.intrinsics, ways)
    margin = _MARGIN * camera.width
    beyond = [depth <= 0, y < -margin * depth, y > (camera.height + margin) * depth]
    if not camera.wraps:
        beyond += [x < -margin * depth, x > (camera.width + margin) * depth]
    out = np.packbits(beyond, axis=0)[0]  # for each vertex, a bit for each side
    a, b, c = faces.T
    return np.asarray(out[a] & out[b] & out[c] == 0)


def _longest(camera: Camera, before: Floats, after: Floats) -> float:
    """Longest displacement (px) from triangles (n, 3, 3) to others.

    For those that extend out of the image, the angle at their smallest possible distance counts.
    """
    places = camera.project(before)
    with np.errstate(invalid="ignore"):
        px = np.linalg.norm(camera.displacement(after, places), axis=-1).max(axis=1)
        inside = ((places >= 0) & (places <= [camera.width, camera.height])).all(axis=(1, 2))
    center = before.mean(axis=1)
    radius = np.linalg.norm(before - center[:, None], axis=-1).max(axis=1)
    near = (np.linalg.norm(center, axis=1) - radius).clip(1e-9)
    angle = np.linalg.norm(after - before, axis=-1).max(axis=1) / near
    px = np.where(inside & np.isfinite(px), px, _px_per_rad(camera) * angle)
    return float(px.max(initial=0.0))


def _px_per_rad(camera: Camera) -> float:
    """Largest number of px per angle along the image's border and its middle row and column."""
    columns, rows = np.arange(camera.width + 1.0), np.arange(camera.height + 1.0)
    rims = ([0, size // 2, size] for size in camera.shape)
    lines = [np.stack([columns, np.full_like(columns, y)], axis=-1) for y in next(rims)]
    lines += [np.stack([np.full_like(rows, x), rows], axis=-1) for x in next(rims)]
    steps = [np.linalg.norm(np.diff(camera.toward(each), axis=0), axis=1) for each in lines]
    return float(1 / np.concatenate(steps).min().clip(1e-9))


def _round_number(least: int) -> int:
    """Return the next of 1, 2, 3, 4, 6, 8, 12…: kernels are compiled for each number of rows."""
    power = 1 << (least - 1).bit_length()
    return power * 3 // 4 if power > 2 and power * 3 // 4 >= least else power
