"""Trace our own rays through a loaded scene: nearest hits and visibility, in any variant.

Mitsuba's camera samples start on the near plane and are jittered, and its interpolated hit points
are off by up to 1e-2 px; distances along our own rays keep float32's full accuracy. Scalar variants
take one ray per call, vectorized ones all at once.
"""

from dataclasses import dataclass
from typing import Any

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]

# A visibility ray stops this fraction short of its target, so that the target does not hide itself.
VISIBILITY_MARGIN = 2e-4


@dataclass(frozen=True)
class Hits:
    """Nearest hits of N rays.

    Attributes
    ----------
    distance : (N,) float64
        Along the unit direction, m; infinite where nothing was hit.
    mesh : (N,) int64
        Index of the mesh hit, as loaded.
    triangle : (N,) int64
        Index of the triangle in that mesh.
    """

    distance: Float64
    mesh: NDArray[np.int64]
    triangle: NDArray[np.int64]


def nearest_hits(scene: Any, origin: Float64, directions: Float64) -> Hits:
    """Nearest hit of rays from one origin (3,) along unit directions (N, 3)."""
    if mi.variant().startswith("scalar"):
        return _nearest_hits_scalar(scene, origin, directions)
    found = scene.ray_intersect_preliminary(_rays(origin, directions), coherent=True)
    return Hits(
        np.array(found.t, dtype=np.float64),
        np.array(found.shape_index, dtype=np.int64),
        np.array(found.prim_index, dtype=np.int64),
    )


def is_hidden(
    scene: Any, origin: Float64, directions: Float64, distances: Float64
) -> NDArray[np.bool_]:
    """Whether anything is nearer than `distances` (N,) along directions (N, 3) from origin (3,)."""
    limits = np.minimum(distances * (1 - VISIBILITY_MARGIN), np.finfo(np.float32).max)
    if mi.variant().startswith("scalar"):
        return _is_hidden_scalar(scene, origin, directions, limits)
    rays = _rays(origin, directions)
    rays.maxt = mi.Float(limits)
    return np.array(scene.ray_test(rays, coherent=True), dtype=bool)


def _rays(origin: Float64, directions: Float64) -> Any:
    return mi.Ray3f(mi.Point3f(*origin.tolist()), mi.Vector3f(np.ascontiguousarray(directions.T)))


def _nearest_hits_scalar(scene: Any, origin: Float64, directions: Float64) -> Hits:
    start = mi.Point3f(origin.tolist())
    hits = (
        scene.ray_intersect_preliminary(mi.Ray3f(start, direction))
        for direction in directions.tolist()
    )
    rows = [(hit.t, hit.shape_index, hit.prim_index) for hit in hits]
    distance, mesh, triangle = np.array(rows, dtype=np.float64).reshape(-1, 3).T
    return Hits(distance, mesh.astype(np.int64), triangle.astype(np.int64))


def _is_hidden_scalar(
    scene: Any, origin: Float64, directions: Float64, limits: Float64
) -> NDArray[np.bool_]:
    start = mi.Point3f(origin.tolist())
    rays = zip(directions.tolist(), limits.tolist(), strict=True)
    return np.array(
        [scene.ray_test(mi.Ray3f(mi.Ray3f(start, d), maxt=t)) for d, t in rays], dtype=bool
    )
