"""Surfaces of a scene hit by rays, at any time, and their image in another frame.

A ray's hit is found in float32 by the renderer's own tracing; its triangle is then intersected
again in float64. A point of a moving object keeps its barycentric coordinates. Moments are cached,
as a frame and its two neighbors share them. Coordinates are relative to the scene's `origin_m`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Ints, Mask
from megalopta.core.compiling import compiled
from megalopta.render.loading import scene as loading
from megalopta.render.loading.meshes import MergedMesh, MovingMesh
from megalopta.render.truth.moving import MovingTriangles
from megalopta.scenes import Shutter
from megalopta.scenes.cameras.base import Camera

Times = float | Floats
"""One time for all, or one for each."""

# Each step is shorter than the previous one by the displacement of the image during the readout
# over its size, so the last one is far below this; float32 positions allow no less.
_ITERATIONS, _TOLERANCE_PX = 60, 1e-4


@dataclass(frozen=True)
class Eyes:
    """Origins, camera rotations and times of N rays."""

    origin: Floats
    """(3,) or (N, 3): camera position, m; one for all rays or one for each."""
    rotation: Floats
    """(3, 3) or (N, 3, 3): camera axes to world."""
    time_s: Times
    """Time: one for all rays or one for each (N,)."""

    def to_world(self, vectors: Floats) -> Floats:
        """Convert vectors (N, 3) from camera axes to world axes."""
        return _times(self.rotation, vectors)

    def to_camera(self, vectors: Floats) -> Floats:
        """Convert vectors (N, 3) from world axes to camera axes."""
        return _times(self.rotation.swapaxes(-1, -2), vectors)

    def of(self, ray: slice | Ints, times: int = 1) -> "Eyes":
        """Return the eyes of some of the rays, each repeated for a number of new rays."""
        if isinstance(self.time_s, float):
            return self
        return Eyes(
            *(part[ray].repeat(times, 0) for part in (self.origin, self.rotation, self.time_s))
        )

    def way(self, points: Floats, is_sky: Mask) -> Floats:
        """Vectors (N, 3) to points (N, 3), which are directions for the sky (N,)."""
        return np.where(is_sky[:, None], points, points - self.origin)


def _times(rotation: Floats, vectors: Floats) -> Floats:
    # Not matmul, which wakes all of BLAS's threads for products of three numbers.
    subscripts = "ij,nj->ni" if rotation.ndim == 2 else "nij,nj->ni"
    return np.asarray(np.einsum(subscripts, rotation, vectors))


Ways = Callable[[Eyes], Floats]
"""Vectors (N, 3) from eyes to N points at the eyes' times."""


def of_rays(times_s: Times, ray: slice | Ints | Mask) -> Times:
    """Times of some of the rays."""
    return times_s if isinstance(times_s, float) else times_s[ray]


@dataclass(frozen=True)
class Instant:
    """Frame taken at an instant."""

    time_s: float
    pose: Floats
    """(4, 4): camera to world."""

    def pixels(self, camera: Camera) -> Eyes:
        """Eyes of the H·W pixels."""
        return Eyes(self.pose[:3, 3], self.pose[:3, :3], self.time_s)

    def seeing(self, camera: Camera, way: Ways, count: int) -> tuple[Eyes, Eyes]:
        """Eyes that see N points, the same for all, twice."""
        eyes = self.pixels(camera)
        return eyes, eyes


@dataclass(frozen=True)
class Rolling:
    """Frame taken line by line, by rows or columns, with moving objects at each line's time."""

    time_s: float
    """Time of the middle line."""
    shutter: Shutter
    pose_at: Callable[[Floats], Floats]
    """Poses (n, 4, 4) at times (n,), s."""

    def pixels(self, camera: Camera) -> Eyes:
        """Eyes of the H·W pixels, one pose per line."""
        across = self.shutter.across
        lines = self._eyes(np.arange(camera.shape[1 - across], dtype=float) + 0.5, camera)
        return lines.of(np.indices(camera.shape)[1 - across].ravel())

    def seeing(self, camera: Camera, way: Ways, count: int) -> tuple[Eyes, Eyes]:
        """Eyes that see N points, at the time of their place, and those of the line around it.

        That place is the fixed point of "seen at y at the time of y", of columns with x. If it is
        not found, because the image moves by more than the lines do, the rotation is NaN. Points
        farther out of the image than its size have the time of that place.
        """
        across = self.shutter.across
        size = camera.shape[1 - across]
        place = np.full(count, size / 2)
        for _ in range(_ITERATIONS):
            eyes = self._eyes(place, camera)
            seen = camera.project(eyes.to_camera(way(eyes)))[:, across]
            seen = np.clip(np.where(np.isnan(seen), place, seen), -size, 2 * size)
            step = np.abs(seen - place)
            place = seen
            if step.max(initial=0) < _TOLERANCE_PX:
                break
        eyes = self._eyes(place, camera)
        lost = (step >= _TOLERANCE_PX)[:, None, None]
        turned = replace(eyes, rotation=np.where(lost, np.nan, eyes.rotation))
        return turned, self._eyes(np.floor(place) + 0.5, camera)

    def _eyes(self, place: Floats, camera: Camera) -> Eyes:
        size = camera.shape[1 - self.shutter.across]
        times = self.time_s + self.shutter.delay_s(place, size)
        poses = self.pose_at(times)
        return Eyes(poses[:, :3, 3], poses[:, :3, :3], times)


View = Instant | Rolling
"""View of a frame."""


@dataclass(frozen=True)
class Surface:
    """Surface points seen by N rays."""

    triangle: Ints
    """(N,): row of the triangle in the geometry's tables; -1 for the sky."""
    points: Floats
    """(N, 3): point on the surface, m; for the sky the ray's direction."""
    directions: Floats
    """(N, 3): directions of the rays."""
    barycentric: Floats
    """(N, 2): weights of the triangle's second and third vertex, if objects move."""
    distance: Floats
    """(N,): distance along the ray, m; infinite for the sky."""
    time_s: Times
    """Times of the rays."""

    @property
    def is_sky(self) -> Mask:
        """True where nothing was hit (N,)."""
        return self.triangle < 0

    def of(self, ray: Mask) -> "Surface":
        """Return the surface points of some of the rays."""
        parts = self.points[ray], self.directions[ray], self.barycentric[ray], self.distance[ray]
        return Surface(self.triangle[ray], *parts, of_rays(self.time_s, ray))


@compiled
def same_side(triangle, at_rest, faces, vertices, seen, way):  # type: ignore[no-untyped-def]
    """True if both directions (N, 3) hit the same side of triangles at rest, or the sky."""
    is_same = np.ones(len(triangle), np.bool_)
    u, v = np.empty(3), np.empty(3)
    for ray in range(len(triangle)):
        if not 0 <= triangle[ray] < at_rest:
            continue
        a, b, c = faces[triangle[ray]]
        for axis in range(3):
            start = np.float64(vertices[a, axis])
            u[axis], v[axis] = vertices[b, axis] - start, vertices[c, axis] - start
        x = u[1] * v[2] - u[2] * v[1]
        y = u[2] * v[0] - u[0] * v[2]
        z = u[0] * v[1] - u[1] * v[0]
        once = x * seen[ray, 0] + y * seen[ray, 1] + z * seen[ray, 2]
        is_same[ray] = once * (x * way[ray, 0] + y * way[ray, 1] + z * way[ray, 2]) > 0
    return is_same


# Beyond this relative difference the float32 hit is right: the ray grazes its triangle and misses
# it in float64.
_GRAZING = 1e-4


class Geometry:
    """Triangles of merged meshes, and the loaded scenes that trace them.

    Meshes come as from `merge`, those at rest first, and are loaded in order. `object_id` (F + 1,)
    is the object of each triangle; the last, for the sky, is 0. `still` is a loaded scene of the
    objects at rest.
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
        # Objects at rest share their buffers with the rendered scene.
        self.still = loading.of_shapes(loaded.shapes()[:at_rest]) if self._moving else loaded
        self._rays = loading.SceneRays(self.still)
        self._moments: dict[float, tuple[loading.SceneRays, NDArray[np.float32]]] = {}
        # Its own surface would be a new kind of surface, and kernels would be compiled anew.
        self._surface = loaded.shapes()[0].bsdf() if self._moving else None

    def seen(self, origin: Floats, directions: Floats, time_s: Times) -> Surface:
        """Surface seen by rays from an origin (3,) or (N, 3) along unit directions (N, 3).

        All have one time, or each its own (N,).
        """
        surface = self.glimpsed(origin, directions, time_s)
        hit = ~surface.is_sky
        points = surface.points.copy()
        corners = self.corners(surface.triangle[hit], of_rays(surface.time_s, hit))
        along, coarse = surface.directions[hit], surface.distance[hit]
        start = np.broadcast_to(origin, points.shape)[hit]
        perpendicular = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        with np.errstate(divide="ignore", invalid="ignore"):
            fine = _dot(perpendicular, corners[:, 0] - start) / _dot(perpendicular, along)
            is_good = np.abs(fine - coarse) <= _GRAZING * coarse
        points[hit] = start + np.where(is_good, fine, coarse)[:, None] * along
        fine_surface = replace(surface, points=points)
        return self._placed_in_triangles(fine_surface) if self._moving else fine_surface

    def glimpsed(self, origin: Floats, directions: Floats, time_s: Times) -> Surface:
        """Surface seen by rays, as `seen`, to the renderer's own float32 precision."""
        distance, *hits = self._rays.nearest(origin, directions)
        triangle = self._rows(distance, *hits)
        if self._moving and not isinstance(time_s, float):
            starts = np.broadcast_to(origin, directions.shape)
            distance, rows = self._rolling.nearest(starts, directions, time_s, distance)
            triangle = np.where(rows >= 0, rows, triangle)
        elif self._moving and isinstance(time_s, float):
            of_moving, mesh, number = self._at(time_s)[0].nearest(origin, directions)
            rows = self._rows(of_moving, self._meshes_at_rest + mesh, number)
            triangle = np.where(of_moving < distance, rows, triangle)
            distance = np.minimum(of_moving, distance)
        is_sky = triangle < 0
        points = np.where(is_sky, 1.0, distance)[:, None] * directions
        points += np.where(is_sky[:, None], 0.0, origin)
        nowhere = np.broadcast_to(0.0, (len(points), 2))
        surface = Surface(triangle, points, directions, nowhere, distance, time_s)
        return self._placed_in_triangles(surface) if self._moving else surface

    def normal(self, surface: Surface) -> Floats:
        """Geometric unit normals (N, 3), toward the rays' origins; NaN for the sky."""
        normal, hit = np.full(surface.points.shape, np.nan), ~surface.is_sky
        cross = self._perpendicular(surface.triangle[hit], of_rays(surface.time_s, hit))
        size = np.sqrt(np.maximum(_dot(cross, cross), 1e-300))
        normal[hit] = cross * (-np.sign(_dot(cross, surface.directions[hit])) / size)[:, None]
        return normal

    def faces(self, surface: Surface, way: Floats, time_s: Times) -> Mask:
        """True if the seen side still faces a viewer at a time (N,).

        `way` (N, 3) leads from the viewer to the surface's points. A leaf has two sides and no
        thickness: a view of the other side does not show these points. The sky faces every viewer.
        """
        seen = same_side(
            surface.triangle, self._triangles_at_rest, self._faces, self._vertices,
            surface.directions, way,
        )  # fmt: skip
        moving = self._moves(surface)
        if moving.any():
            triangle = surface.triangle[moving]
            before, after = (
                self._perpendicular(triangle, of_rays(time, moving))
                for time in (surface.time_s, time_s)
            )
            seen[moving] = _dot(before, surface.directions[moving]) * _dot(after, way[moving]) > 0
        return np.asarray(seen)

    def is_hidden(
        self, origin: Floats, directions: Floats, distances: Floats, time_s: Times
    ) -> Mask:
        """True if anything is nearer than distances (N,), in units of directions (N, 3).

        The rays start at an origin (3,) or each at its own (N, 3), and so with times.
        """
        hidden = self._rays.is_hidden(origin, directions, distances)
        if not self._moving:
            return hidden
        if isinstance(time_s, float):
            return hidden | self._at(time_s)[0].is_hidden(origin, directions, distances)
        starts = np.broadcast_to(origin, directions.shape)
        limits = loading.visibility_limits(distances)
        return hidden | (self._rolling.nearest(starts, directions, time_s, limits)[1] >= 0)

    def carried(self, surface: Surface, time_s: Times) -> Floats:
        """Positions of a surface's points at another time, or each at its own (N, 3)."""
        moving = self._moves(surface)
        if not moving.any():
            return surface.points
        points = surface.points.copy()
        corners = self.corners(surface.triangle[moving], of_rays(time_s, moving))
        u, v = surface.barycentric[moving].T[..., None]
        points[moving] = (1 - u - v) * corners[:, 0] + u * corners[:, 1] + v * corners[:, 2]
        return points

    def _moves(self, surface: Surface) -> Mask:
        return np.asarray(surface.triangle >= self._triangles_at_rest)

    @cached_property
    def _rolling(self) -> MovingTriangles:
        return MovingTriangles(self._moving, self._triangles_at_rest)

    def _rows(self, distance: Floats, mesh: Ints, triangle: Ints) -> Ints:
        return np.asarray(np.where(np.isfinite(distance), self._first[mesh] + triangle, -1))

    def corners(self, triangle: Ints, time_s: Times) -> Floats:
        """Vertices (n, 3, 3) of triangles (n,) at a time, or each at its own (n,)."""
        vertex = self._faces[triangle].astype(np.int64)
        count = len(self._vertices)
        if not self._moving:
            return self._vertices[vertex].astype(np.float64)
        corners = np.empty((*vertex.shape, 3))
        still = vertex < count
        corners[still] = self._vertices[vertex[still]]
        if isinstance(time_s, float):
            corners[~still] = self._at(time_s)[1][vertex[~still] - count]
            return corners
        times = np.broadcast_to(time_s[:, None], vertex.shape)
        for mesh in self._moving:
            mine = (vertex >= count) & (vertex < count + len(mesh.vertices))
            corners[mine] = mesh.some_vertices_at(vertex[mine] - count, times[mine])
            count += len(mesh.vertices)
        return corners

    def _perpendicular(self, triangle: Ints, time_s: Times) -> Floats:
        corners = self.corners(triangle, time_s)
        return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])

    def _placed_in_triangles(self, surface: Surface) -> Surface:
        """The same surface with barycentric coordinates for points of moving objects."""
        moving = self._moves(surface)
        barycentric = np.zeros((len(moving), 2))
        times = of_rays(surface.time_s, moving)
        barycentric[moving] = self.inside(surface.triangle[moving], surface.points[moving], times)
        return replace(surface, barycentric=barycentric)

    def inside(self, triangle: Ints, points: Floats, time_s: Times) -> Floats:
        """Barycentric coordinates (n, 2) of points (n, 3) in triangles (n,) at a time."""
        corners = self.corners(triangle, time_s)
        edges = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        perpendicular = np.cross(*edges)
        area = np.maximum(_dot(perpendicular, perpendicular), 1e-300)
        inside = points - corners[:, 0]
        u = _dot(np.cross(inside, edges[1]), perpendicular) / area
        v = _dot(np.cross(edges[0], inside), perpendicular) / area
        return np.stack([u, v], axis=1)

    def _at(self, time_s: float) -> tuple[loading.SceneRays, NDArray[np.float32]]:
        """Moving objects at a time, and their vertices (V, 3)."""
        if time_s in self._moments:
            return self._moments[time_s]
        vertices = [mesh.vertices_at(time_s) for mesh in self._moving]
        if len(self._moments) < 3:  # a frame, the next and the previous one
            bare = (
                replace(mesh, vertices=places, normals=None, uv=None)
                for places, mesh in zip(vertices, self._moving, strict=True)
            )
            loaded = [loading.load_mesh(mesh, mesh_bsdf=self._surface) for mesh in bare]
            rays = loading.SceneRays(loading.of_shapes(loaded))
        else:
            farthest = max(self._moments, key=lambda moment: abs(moment - time_s))
            rays = self._moments.pop(farthest)[0]
            loading.move_meshes(
                rays.scene, {n: (places, None) for n, places in enumerate(vertices)}
            )
        self._moments[time_s] = rays, np.concatenate(vertices)
        return self._moments[time_s]


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray(np.einsum("ij,ij->i", a, b))


def correspondence(
    geometry: Geometry, camera: Camera, surface: Surface, image: Floats, other: View
) -> tuple[Floats, Mask]:
    """Follow surface points (N) from image coordinates (N, 2) to another frame.

    Returns the displacement (N, 2) in px from a ray's start, NaN if undefined, and True (N,) if
    something, or the surface's own other side, is between point and camera.
    """

    def way(eyes: Eyes) -> Floats:
        return eyes.way(geometry.carried(surface, eyes.time_s), surface.is_sky)

    seen, shown = other.seeing(camera, way, len(image))
    ways = way(seen)
    displacement = camera.displacement(seen.to_camera(ways), image)
    ways = ways if shown is seen else way(shown)
    distance = np.where(surface.is_sky, np.inf, 1.0)
    hidden = geometry.is_hidden(shown.origin, ways, distance, shown.time_s)
    hidden |= ~geometry.faces(surface, ways, shown.time_s)
    return displacement, hidden
