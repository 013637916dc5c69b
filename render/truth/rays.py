"""Custom rays through a loaded scene: nearest hits and visibility, in any variant."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import repeat
from typing import Any

import numpy as np

from megalopta.core.arrays import Floats, Ints, Mask
from megalopta.render import dr, mi
from megalopta.render.loading.scene import MeshIndex
from megalopta.render.mitsuba_loader import is_scalar

# A visibility ray stops this fraction short of its target, so that the target does not hide itself.
VISIBILITY_MARGIN = 2e-4


@dataclass(frozen=True)
class Hits:
    """Nearest hits of N rays."""

    distance: Floats
    """(N,): distance in units of the direction; infinite without a hit."""
    mesh: Ints
    """(N,): index of the mesh hit, as loaded."""
    triangle: Ints
    """(N,): index of the triangle in that mesh."""


class SceneRays:
    """Custom rays through one loaded scene."""

    def __init__(self, scene: Any) -> None:
        self.scene, self._is_scalar = scene, is_scalar()
        self._index = None if self._is_scalar else MeshIndex(scene)

    def nearest(self, origin: Floats, directions: Floats) -> Hits:
        """Nearest hit of rays from one origin (3,) or N of them, along directions (N, 3)."""
        if self._index is None:
            distance = np.full(len(directions), np.inf)
            mesh, triangle = np.zeros((2, len(directions)), np.int64)
            for ray, single in enumerate(_single_rays(origin, directions)):
                hit = self.scene.ray_intersect_preliminary(single)
                if hit.is_valid():
                    distance[ray] = hit.t
                    mesh[ray], triangle[ray] = hit.shape_index, hit.prim_index
            return Hits(distance, mesh, triangle)
        hits = self.scene.ray_intersect_preliminary(_rays(origin, directions), coherent=True)
        # Other values of rays without a hit are left over from other work: they are set to zero.
        valid = hits.is_valid()
        distance = dr.select(valid, hits.t, dr.inf)
        mesh, triangle = self._index.of(hits), dr.select(valid, hits.prim_index, 0)
        # All at once: delayed evaluation would trace the rays again.
        dr.eval(distance, mesh, triangle)
        return Hits(
            np.array(distance, np.float64), np.array(mesh, np.int64), np.array(triangle, np.int64)
        )

    def is_hidden(self, origin: Floats, directions: Floats, distances: Floats) -> Mask:
        """True if anything is nearer than distances (N,), in units of directions (N, 3)."""
        limits = visibility_limits(distances)
        if self._is_scalar:
            singles = _single_rays(origin, directions, limits)
            return np.array([self.scene.ray_test(ray) for ray in singles])
        rays = _rays(origin, directions)
        rays.maxt = mi.Float(limits)
        return np.array(self.scene.ray_test(rays, coherent=True), dtype=bool)


def visibility_limits(distances: Floats) -> Floats:
    """End of rays to targets at distances (N,)."""
    return np.minimum(distances * (1 - VISIBILITY_MARGIN), np.finfo(np.float32).max)


def _rays(origin: Floats, directions: Floats) -> Any:
    start, along = (np.ascontiguousarray(part.T) for part in (np.atleast_2d(origin), directions))
    return mi.Ray3f(mi.Point3f(start), mi.Vector3f(along))


def _single_rays(origin: Floats, directions: Floats, limits: Floats | None = None) -> Iterator[Any]:
    starts = np.broadcast_to(origin, directions.shape).tolist()
    ends = repeat(float("inf")) if limits is None else limits.tolist()
    for start, along, end in zip(starts, directions.tolist(), ends, strict=False):
        ray = mi.Ray3f(mi.Point3f(start), mi.Vector3f(along))
        ray.maxt = end
        yield ray
