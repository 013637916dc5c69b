"""The surfaces of a scene as rays meet them, at any time.

A ray's hit is found in float32 by the renderer's own tracing; which triangle it names is then
intersected again in float64, so that the point is exact on the surface as rendered. A point of a
moving object keeps its barycentric coordinates, and so its place at another time follows from its
triangle's vertices, for rigid and for bending objects alike.

Only what moves is brought to a time, in a small scene of its own; moments are kept, because a frame
and its two neighbors need the same ones. All coordinates are relative to the scene's `origin_m`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.render.loading import MergedMesh, MovingMesh, bare_mesh, gather, move_meshes
from megalopta.render.truth import rays

Float64 = NDArray[np.float64]
Integers = NDArray[np.int64]

# A frame, the next and the one before.
_MOMENTS_KEPT = 3
# Beyond this relative difference the float32 hit is right: the ray grazes its triangle and misses
# it in float64.
_GRAZING = 1e-4


@dataclass(frozen=True)
class Surface:
    """What N rays see."""

    triangle: Integers
    """(N,): row of the triangle in the geometry's tables; -1 for the sky."""
    points: Float64
    """(N, 3): place on the surface, m; for the sky the ray's direction."""
    normal: Float64
    """(N, 3): geometric unit normal, toward the ray's origin; NaN for the sky."""
    barycentric: Float64
    """(N, 2): weights of the triangle's second and third vertex."""
    distance: Float64
    """(N,): along the ray, m; infinite for the sky."""
    time_s: float
    """When it is seen."""

    @property
    def is_sky(self) -> NDArray[np.bool_]:
        """Where nothing was hit (N,)."""
        return self.triangle < 0


@dataclass(frozen=True)
class _Moment:
    scene: Any
    vertices: NDArray[np.float32]


class Geometry:
    """Triangles of merged meshes and the loaded scenes that trace them.

    Meshes come as `merge` gives them, those at rest first, and are loaded in their order.
    `object_id` (F + 1,) is the object of each triangle; the last, of the sky, is 0.
    """

    def __init__(self, meshes: Sequence[MergedMesh], loaded: Any) -> None:
        sizes = [len(mesh.faces) for mesh in meshes]
        offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
        self._first = np.cumsum([0, *sizes])
        shifted = (m.faces + np.uint32(n) for m, n in zip(meshes, offsets, strict=False))
        self._faces = np.concatenate([np.zeros((0, 3), np.uint32), *shifted])
        ids = (mesh.object_id for mesh in meshes)
        self.object_id = np.concatenate([*ids, np.zeros(1, np.uint32)])
        self._moving = [mesh for mesh in meshes if isinstance(mesh, MovingMesh)]
        at_rest = len(meshes) - len(self._moving)
        self._meshes_at_rest = at_rest
        self._triangles_at_rest = int(self._first[at_rest])
        still = (mesh.vertices for mesh in meshes[:at_rest])
        self._vertices = np.concatenate([np.zeros((0, 3), np.float32), *still])
        # What is at rest shares its buffers with the scene that is rendered.
        self._still = gather(loaded.shapes()[:at_rest]) if self._moving else loaded
        self._moments: dict[float, _Moment] = {}

    @property
    def is_moving(self) -> bool:
        """Whether anything moves."""
        return bool(self._moving)

    def seen(self, origin: Float64, directions: Float64, time_s: float) -> Surface:
        """What rays from an origin (3,) or (N, 3) along unit directions (N, 3) see at a time."""
        return self._refined(self.glimpsed(origin, directions, time_s), origin, directions)

    def glimpsed(self, origin: Float64, directions: Float64, time_s: float) -> Surface:
        """What rays see, as `seen`, to the renderer's own float32 precision."""
        hits = rays.nearest_hits(self._still, origin, directions)
        triangle = self._rows(hits, 0)
        if self._moving:
            moving = rays.nearest_hits(self._at(time_s).scene, origin, directions)
            nearer = moving.distance < hits.distance
            triangle = np.where(nearer, self._rows(moving, self._meshes_at_rest), triangle)
            hits = rays.Hits(
                *(
                    np.where(nearer if a.ndim == 1 else nearer[:, None], a, b)
                    for a, b in zip(vars(moving).values(), vars(hits).values(), strict=True)
                )
            )
        is_sky = (triangle < 0)[:, None]
        reach = np.where(np.isinf(hits.distance), 1.0, hits.distance)[:, None] * directions
        points = reach + np.where(is_sky, 0.0, origin)
        side = -np.sign(_dot(hits.normal, directions))
        normal = np.where(is_sky, np.nan, side[:, None] * hits.normal)
        return Surface(triangle, points, normal, hits.barycentric, hits.distance, time_s)

    def faces(self, surface: Surface, way: Float64, time_s: float) -> NDArray[np.bool_]:
        """Whether the side that was seen still faces someone at a time (N,).

        The way (N, 3) leads from there to the surface's points. A leaf has two sides and no
        thickness: who looks at the other one does not see these points. The sky faces everyone.
        """
        normal = surface.normal
        moving = surface.triangle >= self._triangles_at_rest
        if self._moving and moving.any():
            triangle = surface.triangle[moving]
            before, after = (
                self._perpendicular(triangle, time) for time in (surface.time_s, time_s)
            )
            side = np.sign(_dot(before, normal[moving]))
            normal = normal.copy()
            normal[moving] = side[:, None] * after
        return np.asarray(surface.is_sky | (_dot(normal, way) < 0))

    def is_hidden(
        self, origin: Float64, directions: Float64, distances: Float64, time_s: float
    ) -> NDArray[np.bool_]:
        """Whether anything is nearer than distances (N,) on rays from the origin(s) at a time."""
        hidden = rays.is_hidden(self._still, origin, directions, distances)
        if self._moving:
            hidden |= rays.is_hidden(self._at(time_s).scene, origin, directions, distances)
        return hidden

    def carried(self, surface: Surface, time_s: float) -> Float64:
        """Where the points of a surface are at another time (N, 3)."""
        if not self._moving:
            return surface.points
        points = surface.points.copy()
        moving = surface.triangle >= self._triangles_at_rest
        corners = self.corners(surface.triangle[moving], time_s)
        u, v = surface.barycentric[moving].T[..., None]
        points[moving] = (1 - u - v) * corners[:, 0] + u * corners[:, 1] + v * corners[:, 2]
        return points

    def _rows(self, hits: rays.Hits, first_mesh: int) -> Integers:
        hit = np.isfinite(hits.distance)
        rows = np.full(len(hit), -1, dtype=np.int64)
        rows[hit] = self._first[first_mesh + hits.mesh[hit]] + hits.triangle[hit]
        return rows

    def corners(self, triangle: Integers, time_s: float) -> Float64:
        """Vertices (n, 3, 3) of triangles (n,) at a time."""
        vertex = self._faces[triangle].astype(np.int64)
        if not self._moving:
            return self._vertices[vertex].astype(np.float64)
        corners = np.empty((*vertex.shape, 3))
        count = len(self._vertices)
        still = vertex < count
        corners[still] = self._vertices[vertex[still]]
        corners[~still] = self._at(time_s).vertices[vertex[~still] - count]
        return corners

    def _perpendicular(self, triangle: Integers, time_s: float) -> Float64:
        corners = self.corners(triangle, time_s)
        return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])

    def _refined(self, surface: Surface, origin: Float64, directions: Float64) -> Surface:
        """The same surface with points on its triangles in float64."""
        hit = ~surface.is_sky
        points, normal = surface.points.copy(), surface.normal.copy()
        barycentric = surface.barycentric.copy()
        corners = self.corners(surface.triangle[hit], surface.time_s)
        start, along, coarse = (
            np.broadcast_to(origin, points.shape)[hit],
            directions[hit],
            surface.distance[hit],
        )
        edges = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        perpendicular = np.cross(*edges)
        area = np.maximum(_dot(perpendicular, perpendicular), 1e-300)
        with np.errstate(divide="ignore", invalid="ignore"):
            fine = _dot(perpendicular, corners[:, 0] - start) / _dot(perpendicular, along)
            is_good = np.abs(fine - coarse) <= _GRAZING * coarse
        points[hit] = start + np.where(is_good, fine, coarse)[:, None] * along
        inside = points[hit] - corners[:, 0]
        barycentric[hit, 0] = _dot(np.cross(inside, edges[1]), perpendicular) / area
        barycentric[hit, 1] = _dot(np.cross(edges[0], inside), perpendicular) / area
        side = -np.sign(_dot(perpendicular, along))
        normal[hit] = perpendicular * (side / np.sqrt(area))[:, None]
        return replace(surface, points=points, normal=normal, barycentric=barycentric)

    def _at(self, time_s: float) -> _Moment:
        """What moves, at a time."""
        if time_s in self._moments:
            return self._moments[time_s]
        vertices = [mesh.vertices_at(time_s) for mesh in self._moving]
        if len(self._moments) < _MOMENTS_KEPT:
            pairs = zip(vertices, self._moving, strict=True)
            scene = gather([bare_mesh(positions, mesh.faces) for positions, mesh in pairs])
        else:
            farthest = max(self._moments, key=lambda moment: abs(moment - time_s))
            scene = self._moments.pop(farthest).scene
            move_meshes(scene, dict(enumerate(vertices)))
        self._moments[time_s] = _Moment(scene, np.concatenate(vertices))
        return self._moments[time_s]


def _dot(a: Float64, b: Float64) -> Float64:
    return np.asarray(np.einsum("ij,ij->i", a, b))
