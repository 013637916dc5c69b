"""Hits of moving objects by rays that each have their own time, like the rows of a frame.

Rebuilding the structure of a forest for every row costs seconds. So moving triangles are grouped in
clusters, in boxes that nothing leaves that moves steadily on the scale of `_STEP_S`. Only those
that a narrow bundle of rays of one time may hit are moved to its time, and intersected in float64.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from megalopta.core.arrays import Floats, Ints
from megalopta.core.compiling import compiled
from megalopta.render.loading.meshes import MovingMesh

_STEP_S, _FEWEST_STEPS, _MOST_STEPS = 0.01, 4, 64
"""Time between the moments of a box, and limits of their number."""
_BITS = 10
"""Bits of a position along an axis, in the order of clusters."""


class ClusterBounds(NamedTuple):
    """Bounding boxes (C, 3) of clusters from one time to another, s."""

    start_s: float
    end_s: float
    low: Floats
    high: Floats


class MovingTriangles:
    """Triangles of moving meshes, numbered from `first` on in order."""

    def __init__(self, meshes: Sequence[MovingMesh], first: int) -> None:
        motions = {id(part.motion): part.motion for mesh in meshes for part in mesh.parts}
        self._motions = list(motions.values())
        number = {key: index for index, key in enumerate(motions)}
        self._origin_m = np.asarray(meshes[0].origin_m)
        offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
        placed = np.concatenate([mesh.placed for mesh in meshes])
        faces = np.concatenate(
            [mesh.faces.astype(np.int64) + n for mesh, n in zip(meshes, offsets, strict=False)]
        )
        sizes = [part.vertices.stop - part.vertices.start for m in meshes for part in m.parts]
        motion = [number[id(part.motion)] for mesh in meshes for part in mesh.parts]
        motion_of = np.repeat(motion, sizes)[faces[:, 0]]
        order = np.lexsort((_places_in_order(placed[faces].mean(axis=1)), motion_of))
        self._triangle, motion_of = order + first, motion_of[order]
        begins = np.append(0, np.flatnonzero(np.diff(motion_of)) + 1)
        rank = np.arange(len(motion_of)) - np.repeat(
            begins, np.diff(np.append(begins, len(motion_of)))
        )
        starts = np.flatnonzero(rank % 64 == 0)  # triangles per cluster
        self._first_face = np.append(starts, len(order))
        self._motion_of = motion_of[starts]
        # Each cluster has its own vertices, in sequence.
        cluster = np.repeat(np.arange(len(starts)), np.diff(self._first_face))
        keys = cluster[:, None] * len(placed) + faces[order]
        unique, corner = np.unique(keys, return_inverse=True)
        self._faces = corner.reshape(-1, 3)
        self._placed = placed[unique % len(placed)]
        bounds = np.arange(len(starts) + 1) * len(placed)
        self._first_vertex = np.searchsorted(unique, bounds)
        self._bounds_kept: list[ClusterBounds] = []

    def nearest(
        self, origin: Floats, directions: Floats, times_s: Floats, limits: Floats
    ) -> tuple[Floats, Ints]:
        """Distances (N,) of the first hits, in units of directions (N, 3), and their triangles.

        Rays of one time start at one point of `origin` (N, 3). Where nothing is nearer than the
        limits (N,), triangles (N,) are -1 and distances the limits.
        """
        distance, triangle = limits.copy(), np.full(len(limits), -1)
        known = np.logical_and.reduce(np.isfinite(directions + origin), axis=1)
        if not known.any():
            return distance, triangle
        bounds = self._bounds(float(times_s[known].min()), float(times_s[known].max()))
        rays_known = np.flatnonzero(known)
        in_time = rays_known[np.argsort(times_s[rays_known], kind="stable")]
        for rays in np.split(in_time, np.flatnonzero(np.diff(times_s[in_time])) + 1):
            for members, axes, across, sides in _bundles(directions, rays):
                start, time = origin[rays[0]], float(times_s[rays[0]])
                # Boxes that the bundle may hit.
                middle, half = (
                    (bounds.low + bounds.high) / 2 - start,
                    (bounds.high - bounds.low) / 2,
                )
                farthest = np.einsum("sj,cj->cs", sides, middle)
                farthest += np.einsum("sj,cj->cs", np.abs(sides), half)
                clusters = np.flatnonzero((farthest >= 0).all(axis=1))
                rows, first = _rows_of(self._first_vertex, clusters)
                faces, first_face = _rows_of(self._first_face, clusters)
                moved = self._carried(rows, first, clusters, time)
                shift = np.repeat(first[:-1] - self._first_vertex[clusters], np.diff(first_face))
                corners, number = moved[self._faces[faces] + shift[:, None]], self._triangle[faces]
                far = distance[members]
                met = _meet(across, directions[members], axes, sides, corners - start, far)
                hit = met >= 0
                distance[members], triangle[members[hit]] = far, number[met[hit]]
        return distance, triangle

    def _carried(self, rows: Ints, first: Ints, clusters: Ints, time_s: float) -> Floats:
        """Vertices (n, 3) at a time, rounded like the renderer's, of clusters from rows `first`."""
        moved = self._placed[rows]
        motion = self._motion_of[clusters]
        starts = np.flatnonzero(np.diff(motion, prepend=-1))
        for start, end in pairwise([*starts, len(motion)]):
            members = slice(first[start], first[end])
            moved[members] = self._motions[motion[start]].carry(moved[members], time_s)
        local: Floats = (moved - self._origin_m).astype(np.float32).astype(np.float64)
        return local

    def _bounds(self, start_s: float, end_s: float) -> ClusterBounds:
        for bounds in self._bounds_kept:
            if bounds.start_s <= start_s and end_s <= bounds.end_s:
                return bounds
        padding = 0.1 * (end_s - start_s) + 1e-6  # serves similar queries
        start_s, end_s = start_s - padding, end_s + padding
        steps = math.ceil((end_s - start_s) / _STEP_S)
        count = min(max(steps, _FEWEST_STEPS), _MOST_STEPS) + 1
        every, starts = np.arange(len(self._motion_of)), self._first_vertex[:-1]
        low, high = np.full((len(every), 3), np.inf), np.full((len(every), 3), -np.inf)
        longest, before = np.zeros(low.shape), None
        for time in np.linspace(start_s, end_s, count).tolist():
            rows = np.arange(len(self._placed))
            places = self._carried(rows, self._first_vertex, every, time)
            low = np.minimum(low, np.minimum.reduceat(places, starts))
            high = np.maximum(high, np.maximum.reduceat(places, starts))
            if before is not None:
                ways = np.maximum.reduceat(np.abs(places - before), starts)
                longest = np.maximum(longest, ways)
            before = places
        bounds = ClusterBounds(start_s, end_s, low - longest, high + longest)
        self._bounds_kept = [bounds, *self._bounds_kept[:3]]  # the last 4 are kept
        return bounds


def _places_in_order(points: Floats) -> Ints:
    """Positions (n,) of points (n, 3) along a curve on which neighbors are close (Morton, 1966)."""
    low, size = points.min(axis=0), np.maximum(np.ptp(points, axis=0).max(), 1e-9)
    cells = ((points - low) / size * (2**_BITS - 1)).astype(np.int64)
    number = np.zeros(len(points), np.int64)
    for bit in range(_BITS):
        for axis in range(3):
            number |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return number


def _rows_of(first: Ints, clusters: Ints) -> tuple[Ints, Ints]:
    """Rows of some clusters, where cluster c has those from first[c], and the start of each."""
    counts = first[clusters + 1] - first[clusters]
    begins = np.append(0, np.cumsum(counts))
    shift = np.repeat(first[clusters] - begins[:-1], counts)
    return np.arange(begins[-1]) + shift, begins


def _bundles(directions: Floats, rays: Ints) -> Iterator[tuple[Ints, Floats, Floats, Floats]]:
    """Yield narrow bundles: rays, axes (3, 3), ascending places across, sides (5, 3) of a box."""
    unit = directions[rays] / np.linalg.norm(directions[rays], axis=1, keepdims=True)
    mean = unit.mean(axis=0)
    across = np.linalg.eigh(np.einsum("ni,nj->ij", unit - mean, unit - mean))[1]
    length = np.linalg.norm(mean)
    if length == 0 or (unit @ mean).min() < 0.5 * length:  # rays over 60° off the axis
        side = (unit - mean) @ across[:, 2] > 0
        yield from _bundles(directions, rays[side])
        yield from _bundles(directions, rays[~side])
        return
    along = mean / length
    wide = across[:, 2] - (across[:, 2] @ along) * along
    if np.linalg.norm(wide) < 1e-3:
        wide = np.cross(along, np.eye(3)[np.abs(along).argmin()])
    wide /= np.linalg.norm(wide)
    axes = np.stack([wide, np.cross(along, wide), along])
    places = np.einsum("ij,nj->ni", axes, unit)
    places = places[:, :2] / places[:, 2:]
    low, high = places.min(axis=0) - 1e-9, places.max(axis=0) + 1e-9
    sides = np.concatenate(
        [axes[:2] - low[:, None] * along, high[:, None] * along - axes[:2], [along]]
    )
    order = np.argsort(places[:, 0])
    yield rays[order], axes, places[order, 0], sides


@compiled
def _meet(places, ways, axes, sides, corners, distance):  # type: ignore[no-untyped-def]
    """Triangles (R,) that rays hit, nearer than distances (R,), which are lowered; else -1."""
    met = np.full(len(ways), -1)
    a, b, q, p = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for triangle in range(len(corners)):
        corner = corners[triangle]
        if _is_beside(corner, sides):
            continue
        low, high = _reach(corner, axes)
        for axis in range(3):
            a[axis], b[axis] = corner[1, axis] - corner[0, axis], corner[2, axis] - corner[0, axis]
        _cross(a, corner[0], q)
        along = b[0] * q[0] + b[1] * q[1] + b[2] * q[2]
        for ray in range(np.searchsorted(places, low - 1e-9), np.searchsorted(places, high + 1e-9)):
            way = ways[ray]
            _cross(way, b, p)
            size = a[0] * p[0] + a[1] * p[1] + a[2] * p[2]
            if size == 0:
                continue
            u = -(corner[0, 0] * p[0] + corner[0, 1] * p[1] + corner[0, 2] * p[2]) / size
            v = (way[0] * q[0] + way[1] * q[1] + way[2] * q[2]) / size
            if u >= 0 and v >= 0 and u + v <= 1 and 0 < along / size < distance[ray]:
                distance[ray], met[ray] = along / size, triangle
    return met


@compiled
def _is_beside(corner, sides):  # type: ignore[no-untyped-def]
    """True if a triangle (3, 3) is entirely beyond one of the sides (5, 3)."""
    for side in sides:
        most = -np.inf
        for n in range(3):
            most = max(
                most, side[0] * corner[n, 0] + side[1] * corner[n, 1] + side[2] * corner[n, 2]
            )
        if most < 0:
            return True
    return False


@compiled
def _reach(corner, axes):  # type: ignore[no-untyped-def]
    """Range of a triangle (3, 3) across a bundle; unlimited if partly behind."""
    low, high = np.inf, -np.inf
    for n in range(3):
        x, y, z = corner[n, 0], corner[n, 1], corner[n, 2]
        along = axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * z
        if along <= 0:
            return -np.inf, np.inf
        place = (axes[0, 0] * x + axes[0, 1] * y + axes[0, 2] * z) / along
        low, high = min(low, place), max(high, place)
    return low, high


@compiled
def _cross(a, b, into):  # type: ignore[no-untyped-def]
    into[0] = a[1] * b[2] - a[2] * b[1]
    into[1] = a[2] * b[0] - a[0] * b[2]
    into[2] = a[0] * b[1] - a[1] * b[0]
