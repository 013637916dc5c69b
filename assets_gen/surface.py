"""Triangle meshes under construction, and their conversion to trimesh."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import trimesh

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Surface:
    """Triangle mesh with texture coordinates and normals as arrays."""

    vertices: FloatArray
    """(n, 3): meters."""
    faces: NDArray[np.int64]
    """(m, 3): counterclockwise seen from outside."""
    uv: FloatArray
    """(n, 2): texture coordinates; the texture repeats with period 1."""
    normals: FloatArray | None = None
    """(n, 3): unit vertex normals of a smooth surface; None for flat faces."""
    clusters: NDArray[np.int64] | None = None
    """(m,): number of the twig that bears each face's leaf, from 1; None if there are none."""

    @cached_property
    def area(self) -> float:
        """Area of all faces (m²)."""
        return float(self.face_areas.sum())

    @cached_property
    def face_areas(self) -> FloatArray:
        """Area (m,) of each face (m²)."""
        a, b, c = (self.vertices.take(corner, axis=0) for corner in self.faces.T)
        return lengths(cross(b - a, c - a)) / 2

    def to_mesh(self) -> "trimesh.Trimesh":
        """Return the mesh; `metadata["smooth"]` is True if its vertex normals should be used.

        `metadata["clusters"]` has the faces' clusters, if there are any.
        """
        import trimesh  # slow

        return trimesh.Trimesh(
            self.vertices,
            self.faces,
            vertex_normals=self.normals,
            visual=trimesh.visual.TextureVisuals(uv=self.uv),
            metadata={"smooth": self.normals is not None}
            | ({} if self.clusters is None else {"clusters": self.clusters}),
            process=False,
        )


def grid_corners(rows: int, columns: int) -> tuple[NDArray[np.int64], ...]:
    """Vertices a, b, c, d around each cell of a grid of vertices, numbered row by row.

    a and b are neighbors in a row, d and c those in the next: (a, b, c) and (a, c, d) fill a cell.
    """
    index = np.arange(rows * columns).reshape(rows, columns)
    low, high = index[:-1], index[1:]
    a, b, c, d = (x.ravel() for x in (low[:, :-1], low[:, 1:], high[:, 1:], high[:, :-1]))
    return a, b, c, d


def grid_faces(rows: int, columns: int, inward: bool = False) -> NDArray[np.int64]:
    """Two triangles (2·cells, 3) of each cell of a grid of vertices: first ones, then others.

    If `inward`, cells are split along the other diagonal, and triangles flipped.
    """
    a, b, c, d = grid_corners(rows, columns)
    first, second = ((a, d, b), (b, d, c)) if inward else ((a, b, c), (a, c, d))
    return np.concatenate([np.stack(first, -1), np.stack(second, -1)])


def join(surfaces: Sequence[Surface]) -> Surface:
    """Return the surfaces as one; they must be all smooth or all flat."""
    offsets = np.cumsum([0, *(len(surface.vertices) for surface in surfaces[:-1])])
    normals = [surface.normals for surface in surfaces if surface.normals is not None]
    return Surface(
        np.concatenate([surface.vertices for surface in surfaces]),
        np.concatenate([s.faces + offset for s, offset in zip(surfaces, offsets, strict=True)]),
        np.concatenate([surface.uv for surface in surfaces]),
        np.concatenate(normals) if normals else None,
    )


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the cross products of vectors (…, 3); much faster than numpy's on few vectors."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    product = np.empty(np.broadcast(a, b).shape)
    product[..., 0] = ay * bz - az * by
    product[..., 1] = az * bx - ax * bz
    product[..., 2] = ax * by - ay * bx
    return product


def lengths(vectors: FloatArray) -> FloatArray:
    """Return the lengths (…) of vectors (…, d); much faster than numpy's norm."""
    square = vectors[..., 0] * vectors[..., 0]
    for axis in range(1, vectors.shape[-1]):
        square = square + vectors[..., axis] * vectors[..., axis]
    return np.asarray(np.sqrt(square))


def unit(vectors: FloatArray) -> FloatArray:
    """Return vectors (…, 3) scaled to length 1; a zero vector stays zero."""
    length = lengths(vectors)[..., None]
    length[length == 0] = 1
    return vectors / length
