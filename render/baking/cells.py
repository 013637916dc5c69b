"""Cells of every face side, small enough for uniform light on each, and their survey.

A cell is a piece of one side of one triangle. The two edges that meet opposite the longest edge are
divided into pieces, which spans a grid of parallelograms over the triangle.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from megalopta.core.arrays import Floats
from megalopta.render import dr, mi
from megalopta.render.loading.meshes import MergedMesh
from megalopta.render.loading.scene import MeshIndex
from megalopta.render.path_tracing import hashed
from megalopta.render.shading import Sight
from megalopta.scenes.cameras.base import Camera

UInt32 = NDArray[np.uint32]

PIECE_PX = 0.5
"""Longest piece of an edge, in pixels of the camera at its closest."""
TURN_RAD = 0.25
"""Largest turn of a shading normal along a piece that is longer than a pixel (rad)."""
MOST_PIECES = 128
"""Largest number of pieces of an edge."""
NEAREST_M = 0.3
"""Smallest distance from the camera considered for cutting (m)."""
MOST_CELLS = 2**30
"""Largest number of cells; the table takes four bytes for each."""
VOXEL_PX = 0.5
"""Widest voxel, in pixels of the camera at its closest."""
_BLOCK_OCTAVES, _BLOCK_BITS = 6, 16
"""Size of blocks of voxels over that of these, and first bits of a hash that a block shares."""
_BLOCK_SHIFT = np.uint64(64 - _BLOCK_BITS)
# Odd constants of the hash: golden ratio, and that of the xxHash algorithm.
_MULTIPLIERS = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F], np.uint64)


def pixel_angle(camera: Camera) -> float:
    """Mean angle between neighboring pixels (rad)."""
    directions = camera.directions()
    steps = [
        np.linalg.norm(np.diff(directions, axis=axis), axis=-1).ravel()
        for axis in (0, 1)
        if directions.shape[axis] > 1
    ]
    return float(np.concatenate(steps).mean()) if steps else 1.0


@dataclass(frozen=True)
class Cells:
    """Numbering of the cells of M meshes with F faces in all, in loading order."""

    first_face: UInt32
    """(M,): number of the first face of each mesh."""
    first_cell: UInt32
    """(F,): number of the first cell of each face: front side row by row, then back side."""
    origin: UInt32
    """(F,): corner, 0 to 2, where both coordinates are 0."""
    pieces: UInt32
    """(2, F): number of pieces of the edges to the next corner and to the one after it."""
    count: int
    """Number of all cells."""
    meshes: Sequence[MergedMesh]
    path: cKDTree
    """Positions of the camera."""
    pixel_rad: float

    @classmethod
    def of(cls, meshes: Sequence[MergedMesh], camera: Camera, positions: Floats) -> "Cells":
        """Divide meshes into cells for a camera at positions (T, 3).

        Raises ValueError if there are more cells than a table holds.
        """
        path, pixel_rad = cKDTree(positions), pixel_angle(camera)
        cuts = [_cut(mesh, path, pixel_rad) for mesh in meshes]
        origin = np.concatenate([origin for origin, _ in cuts])
        pieces = np.concatenate([pieces for _, pieces in cuts], axis=1)
        ends = np.cumsum(2 * pieces.prod(axis=0, dtype=np.int64))
        count = int(ends[-1])
        if count > MOST_CELLS:
            raise ValueError(
                f"render.integrator 'baked': the surfaces make {count} cells of a few pixels, "
                f"and {MOST_CELLS} fit; use 'path', or a smaller camera"
            )
        faces = np.cumsum([0, *(len(mesh.faces) for mesh in meshes)])
        return cls(
            faces[:-1].astype(np.uint32),
            np.concatenate([[0], ends[:-1]]).astype(np.uint32),
            origin,
            pieces,
            count,
            meshes,
            path,
            pixel_rad,
        )

    def patches(self, cell: UInt32) -> "Patches":
        """Location of cells (C,)."""
        face = np.searchsorted(self.first_cell, cell, side="right") - 1
        mesh = np.searchsorted(self.first_face, face, side="right") - 1
        pieces = self.pieces[:, face]
        side, place = np.divmod(cell - self.first_cell[face], pieces[0] * pieces[1])
        triangle = (face - self.first_face[mesh]).astype(np.uint32)
        indices = np.stack(np.divmod(place, pieces[1]))
        return Patches(mesh.astype(np.uint32), triangle, side, self.origin[face], pieces, indices)

    def voxels(self, cell: UInt32, octaves: int = 0) -> NDArray[np.uint64]:
        """Hash (C,) that cells (C,) of one cluster share; each octave doubles the voxel size.

        Cells of one mesh, of similar orientation and in the same voxel form a cluster: in foliage a
        pixel sees dozens of leaves at a time, and only their mean matters. In order of the hash,
        clusters that are near in space follow each other, as a rule: their rays are traced faster.
        """
        patches = self.patches(cell)
        corners = np.empty((len(cell), 3, 3))
        for index in np.unique(patches.mesh):
            of_mesh, mesh = patches.mesh == index, self.meshes[index]
            corners[of_mesh] = mesh.vertices[mesh.faces[patches.triangle[of_mesh]]]
        rows = np.arange(len(cell))
        a, b, c = (corners[rows, (patches.origin + step) % 3] for step in range(3))
        u, v = (patches.indices + 0.5) / patches.pieces
        total = np.maximum(u + v, 1)
        center = a + (u / total)[:, None] * (b - a) + (v / total)[:, None] * (c - a)
        normal = np.cross(b - a, c - a) * np.where(patches.side == 0, 1, -1)[:, None]
        axis = np.abs(normal).argmax(axis=1)
        facing = 2 * axis + (normal[rows, axis] > 0)
        size = self.pixel_rad * np.maximum(self.path.query(center)[0], NEAREST_M)
        level = np.floor(np.log2(VOXEL_PX * size)) + octaves
        voxel, block = (
            np.floor(center / np.exp2(octave)[:, None])
            for octave in (level, level + _BLOCK_OCTAVES)
        )
        place = _hashes(level, *block.T) >> _BLOCK_SHIFT << _BLOCK_SHIFT
        return place | _hashes(patches.mesh, level, facing, *voxel.T) >> np.uint64(_BLOCK_BITS)


def _hashes(*columns: NDArray[Any]) -> NDArray[np.uint64]:
    """Hash (N,) of columns (N,) of whole numbers."""
    hashes = np.zeros(len(columns[0]), np.uint64)
    for column in columns:
        hashes ^= column.astype(np.int64).astype(np.uint64)
        for multiplier in _MULTIPLIERS:
            hashes *= multiplier
            hashes ^= hashes >> np.uint64(29)
    return hashes


@dataclass(frozen=True)
class Patches:
    """Location of C cells: mesh, triangle in it, side (1 is the back), and place on the triangle.

    `indices` (2, C) count the pieces from the origin to the cell along both edges.
    """

    mesh: UInt32
    triangle: UInt32
    side: UInt32
    origin: UInt32
    pieces: UInt32
    indices: UInt32

    def barycentric(self, of: Callable[[UInt32], Any], a: Any, b: Any) -> Any:
        """Mitsuba's barycentric coordinates of points (N,) at (a, b), 0 to 1, in cells.

        `of` maps values of cells (C,) to those of points.
        """
        n = [mi.Float(of(pieces)) for pieces in self.pieces]
        index = [mi.Float(of(values)) for values in self.indices]
        u, v = ((i + x) / m for i, x, m in zip(index, (a, b), n, strict=True))
        # A cell on the longest edge lies half outside: its points there are rotated about its
        # center, and those still outside, where numbers of pieces differ, are moved to the edge.
        outside = u + v > 1
        u = dr.select(outside, (2 * index[0] + 1) / n[0] - u, u)
        v = dr.select(outside, (2 * index[1] + 1) / n[1] - v, v)
        total = dr.maximum(u + v, 1)
        u, v = u / total, v / total
        w, origin = 1 - u - v, of(self.origin)
        return mi.Point2f(
            dr.select(origin == 0, u, dr.select(origin == 1, w, v)),
            dr.select(origin == 0, v, dr.select(origin == 1, u, w)),
        )


@dataclass(frozen=True)
class CellSight(Sight):
    """Surfaces seen, of which those at rest are shaded: these have a cell and a place in it."""

    moving: Any
    """True where the surface hit does not emit and is not at rest."""
    cell: Any
    place: tuple[Any, Any]


class CellFinder:
    """Cells that rays hit, inside Mitsuba."""

    def __init__(self, cells: Cells, loaded: Any) -> None:
        self._index, self._at_rest = MeshIndex(loaded), len(cells.first_face)
        self._first_face = mi.UInt(cells.first_face)
        self._first_cell = mi.UInt(cells.first_cell)
        self._origin = mi.UInt(cells.origin)
        self._pieces = [mi.UInt(pieces) for pieces in cells.pieces]

    def look(self, loaded: Any, rays: Any, coherent: bool = True) -> CellSight:
        """Trace rays through a loaded scene; rays of one pixel at a time are coherent."""
        hit = loaded.ray_intersect_preliminary(rays, coherent=coherent)
        point = hit.compute_surface_interaction(rays, mi.RayFlags.All)
        front = point.wi.z > 0
        dull = point.is_valid() & ~point.shape.is_emitter()
        mesh = self._index.of(hit)
        # Moving meshes come after those with cells.
        at_rest = mesh < self._at_rest
        active = dull & at_rest
        face = dr.gather(mi.UInt, self._first_face, mesh, active) + hit.prim_index
        first, origin, *pieces = (
            dr.gather(mi.UInt, table, face, active)
            for table in (self._first_cell, self._origin, *self._pieces)
        )
        b1, b2 = hit.prim_uv
        b0 = 1 - b1 - b2
        u = dr.select(origin == 0, b1, dr.select(origin == 1, b2, b0))
        v = dr.select(origin == 0, b2, dr.select(origin == 1, b0, b1))
        scaled = [dr.maximum(x, 0) * n for x, n in zip((u, v), pieces, strict=True)]
        i, j = (dr.minimum(mi.UInt(x), n - 1) for x, n in zip(scaled, pieces, strict=True))
        side = dr.select(front, mi.UInt(0), mi.UInt(1))
        place = scaled[0] - mi.Float(i), scaled[1] - mi.Float(j)
        cell = first + (side * pieces[0] + i) * pieces[1] + j
        return CellSight(point, front, active, mesh, dull & ~at_rest, cell, place)


def _cut(mesh: MergedMesh, path: cKDTree, pixel_rad: float) -> tuple[UInt32, UInt32]:
    """Origin (F,) and pieces (2, F) of the faces of a mesh."""
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    # Edge i leads from corner i to the next: the longest one leaves the corner after the origin.
    origin = (np.argmax(lengths, axis=1) + 2) % 3
    edges = np.stack([origin, (origin + 2) % 3])
    faces = np.arange(len(origin))
    center = corners.mean(axis=1)
    radius = np.linalg.norm(corners - center[:, None], axis=2).max(axis=1)
    distance = np.maximum(path.query(center)[0] - radius, NEAREST_M)
    pixels = lengths[faces, edges] / (pixel_rad * distance)
    pieces = pixels / PIECE_PX
    if mesh.normals is not None:
        normals = mesh.normals[mesh.faces].astype(np.float64)
        cosines = np.einsum("fij,fij->fi", normals, np.roll(normals, -1, axis=1))
        turns = np.arccos(np.clip(cosines, -1, 1))[faces, edges]
        pieces = np.maximum(pieces, np.minimum(turns / TURN_RAD, pixels))
    return origin.astype(np.uint32), np.ceil(pieces).clip(1, MOST_PIECES).astype(np.uint32)


_PLACES = 1024
"""Number of places along a side of a cell."""
_CHANCE_SHIFT = 20
"""Bits of a place."""
VIEWS = 512
"""Rays per pixel over the whole sequence, of any length. These miss the cells of 1 in 20 rays of a
frame."""


def views(camera: Camera, poses: Floats, count: int, seed: int, step: int = 1) -> Iterator[Any]:
    """Rays for every `step`-th pixel from `count` poses spread over those (T, 4, 4).

    For each view the camera is turned by up to half a pixel at random, so that rays also sample
    between pixel centers, and looks through one point of its lens.
    """
    axes, rng = camera.directions().reshape(-1, 3)[::step], np.random.default_rng(seed)
    turns = rng.uniform(-0.5, 0.5, (count, 3)) * pixel_angle(camera)
    frames = np.linspace(0, len(poses) - 1, count).round().astype(int)
    radius, focus = camera.lens_m or (0.0, 1.0)
    sizes, angles = radius * np.sqrt(rng.random(count)), 2 * np.pi * rng.random(count)
    places = np.stack([sizes * np.cos(angles), sizes * np.sin(angles), 0 * sizes], axis=1)
    for pose, turn, place in zip(poses[frames], turns, places, strict=True):
        turned = Rotation.from_rotvec(turn).apply(axes)
        if radius:
            turned = turned * (focus / turned[:, 2:]) - place
            turned /= np.linalg.norm(turned, axis=1, keepdims=True)
        directions = turned @ pose[:3, :3].T
        start = mi.Point3f((pose[:3, 3] + pose[:3, :3] @ place).tolist())
        dr.make_opaque(start)  # otherwise every view would be compiled anew
        yield mi.Ray3f(start, mi.Vector3f(np.ascontiguousarray(directions.T)))


HITS_AT_ONCE = 2**24
"""Hits of a survey that are held until they are counted."""


def survey(loaded: Any, finder: CellFinder, rays: Iterable[Any]) -> tuple[UInt32, UInt32, UInt32]:
    """Cells (N,) that the rays of some views see, in ascending order.

    Also the number of times (N,) that each is seen, and a place (N,) where, as read by `unpacked`.
    """
    # Of each cell its number, with the largest place below it, and how often it was seen.
    met, seen = np.zeros(0, np.uint64), np.zeros(0, np.uint32)
    batch: list[NDArray[np.uint64]] = []
    for number, view_rays in enumerate(rays):
        sight = finder.look(loaded, view_rays, coherent=False)
        # One of the places at random, independent of the order of threads.
        chance, _ = hashed(dr.arange(mi.UInt, dr.width(sight.cell)), dr.opaque(mi.UInt, number))
        i, j = (mi.UInt(dr.clip(x, 0, 1) * (_PLACES - 1) + 0.5) for x in sight.place)
        packed = (chance >> _CHANCE_SHIFT << _CHANCE_SHIFT) | (i * _PLACES + j)
        dr.eval(sight.cell, packed, sight.shaded)
        hits = np.array(sight.cell, np.uint64) << np.uint64(32) | np.array(packed, np.uint64)
        batch.append(hits[np.array(sight.shaded)])
        if sum(map(len, batch)) > HITS_AT_ONCE:
            met, seen, batch = *_counted(met, seen, batch), []
    met, seen = _counted(met, seen, batch)
    return (met >> np.uint64(32)).astype(np.uint32), seen, met.astype(np.uint32)


def _counted(
    met: NDArray[np.uint64], seen: UInt32, batch: list[NDArray[np.uint64]]
) -> tuple[NDArray[np.uint64], UInt32]:
    """Cells met so far, and how often each was seen, with those of a batch of hits."""
    hits = np.concatenate([met, *batch])
    order = np.argsort(hits)
    hits, times = hits[order], np.pad(seen, (0, len(hits) - len(seen)), constant_values=1)[order]
    last = np.flatnonzero(np.diff(hits >> np.uint64(32), append=2**32))
    return hits[last], np.diff(np.cumsum(times)[last], prepend=0).astype(np.uint32)


def unpacked(places: Any) -> tuple[Any, Any]:
    """Places in cells, (a, b), 0 to 1."""
    i, j = (places // _PLACES) % _PLACES, places % _PLACES
    return mi.Float(i) / (_PLACES - 1), mi.Float(j) / (_PLACES - 1)
