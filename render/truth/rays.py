"""Trace our own rays through a loaded scene: nearest hits and visibility, in any variant.

Mitsuba's camera samples start on the near plane and are jittered, and its interpolated hit points
are off by up to 1e-2 px; distances along our own rays keep float32's full accuracy. Scalar variants
take one ray per call, vectorized ones all at once.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.render import dr, mi
from megalopta.render.loading import MeshIndex

Float64 = NDArray[np.float64]

# A visibility ray stops this fraction short of its target, so that the target does not hide itself.
VISIBILITY_MARGIN = 2e-4


@dataclass(frozen=True)
class Hits:
    """Nearest hits of N rays."""

    distance: Float64
    """(N,): along the unit direction, m; infinite where nothing was hit."""
    mesh: NDArray[np.int64]
    """(N,): index of the mesh hit, as loaded."""
    triangle: NDArray[np.int64]
    """(N,): index of the triangle in that mesh."""
    barycentric: Float64
    """(N, 2): weights of the triangle's second and third vertex."""
    normal: Float64
    """(N, 3): geometric unit normal, on either side."""


def nearest_hits(scene: Any, origin: Float64, directions: Float64) -> Hits:
    """Nearest hit of rays from one origin (3,) or N of them, along unit directions (N, 3)."""
    if _is_scalar():
        return _single_hits(scene, origin, directions)
    rays = _rays(origin, directions)
    hits = scene.ray_intersect_preliminary(rays, coherent=True)
    # What a ray that hit nothing holds elsewhere is left over from other work: it is zero here.
    valid = hits.is_valid()
    distance = dr.select(valid, hits.t, dr.inf)
    mesh = MeshIndex(scene).of(hits)
    triangle = dr.select(valid, hits.prim_index, 0)
    barycentric = dr.select(valid, hits.prim_uv, 0)
    normal = dr.select(valid, hits.compute_surface_interaction(rays, mi.RayFlags.Minimal).n, 0)
    # All at once: what is left for later would trace the rays again.
    dr.eval(distance, mesh, triangle, barycentric, normal)
    return Hits(
        np.array(distance, dtype=np.float64),
        np.array(mesh, dtype=np.int64),
        np.array(triangle, dtype=np.int64),
        np.array(barycentric, dtype=np.float64).T,
        np.array(normal, dtype=np.float64).T,
    )


def is_hidden(
    scene: Any, origin: Float64, directions: Float64, distances: Float64
) -> NDArray[np.bool_]:
    """Whether anything is nearer than distances (N,) along directions (N, 3) from the origin(s)."""
    limits = np.minimum(distances * (1 - VISIBILITY_MARGIN), np.finfo(np.float32).max)
    return np.array(blocked(scene, origin, directions, limits), dtype=bool)


def blocked(scene: Any, origin: Float64, directions: Float64, limits: Float64) -> Any:
    """Mitsuba's own answer: whether anything is hit before the limits, in its types."""
    if not _is_scalar():
        rays = _rays(origin, directions)
        rays.maxt = mi.Float(limits)
        return scene.ray_test(rays, coherent=True)
    pairs = zip(_single_rays(origin, directions), limits.tolist(), strict=True)
    return [scene.ray_test(mi.Ray3f(ray, maxt=limit)) for ray, limit in pairs]


def _single_hits(scene: Any, origin: Float64, directions: Float64) -> Hits:
    found = np.zeros((len(directions), 8))
    found[:, 0] = np.inf
    for row, ray in zip(found, _single_rays(origin, directions), strict=True):
        hit = scene.ray_intersect_preliminary(ray)
        if hit.is_valid():
            normal = hit.compute_surface_interaction(ray, mi.RayFlags.Minimal).n
            row[:] = hit.t, hit.shape_index, hit.prim_index, *hit.prim_uv, *normal
    mesh, triangle = found[:, 1:3].T.astype(np.int64)
    return Hits(found[:, 0], mesh, triangle, found[:, 3:5], found[:, 5:])


def _is_scalar() -> bool:
    return str(mi.variant()).startswith("scalar")


def _rays(origin: Float64, directions: Float64) -> Any:
    start, along = (np.ascontiguousarray(part.T) for part in (np.atleast_2d(origin), directions))
    return mi.Ray3f(mi.Point3f(start), mi.Vector3f(along))


def _single_rays(origin: Float64, directions: Float64) -> Iterator[Any]:
    starts = np.broadcast_to(origin, directions.shape).tolist()
    for start, direction in zip(starts, directions.tolist(), strict=True):
        yield mi.Ray3f(mi.Point3f(start), mi.Vector3f(direction))
