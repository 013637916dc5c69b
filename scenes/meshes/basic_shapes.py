"""Mitsuba's basic shapes as triangles: rectangle, cube, disk, sphere and cylinder."""

from typing import NamedTuple

import numpy as np

from megalopta.core.arrays import Floats, Ints

_ROUND = 96
"""Sides of round shapes: facets are up to 1.1e-3 of the radius below a sphere."""


class Shape(NamedTuple):
    """Triangles of a shape, with smooth normals if it is round."""

    vertices: Floats
    """(V, 3)."""
    faces: Ints
    """(F, 3)."""
    uv: Floats | None = None
    """(V, 2), as Mitsuba's."""
    normals: Floats | None = None
    """(V, 3)."""


def rectangle() -> Shape:
    """Return a square of side 2 with normal +z."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    return Shape(corners, np.array([[0, 1, 2], [0, 2, 3]]), (corners[:, :2] + 1) / 2)


def cube() -> Shape:
    """Return a cube of side 2, without texture coordinates."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1.0)])
    sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = [[side[0], side[n], side[n + 1]] for side in sides for n in (1, 2)]
    return Shape(corners, np.array(faces))


def disk() -> Shape:
    """Return a disk of radius 1 with normal +z, without texture coordinates."""
    rim = _circle()[:-1]
    vertices = np.concatenate([np.zeros((1, 3)), np.column_stack([rim, np.zeros(_ROUND)])])
    around = np.arange(_ROUND)
    faces = np.column_stack([np.zeros(_ROUND, int), around + 1, (around + 1) % _ROUND + 1])
    return Shape(vertices, faces)


def sphere(center: Floats, radius: float) -> Shape:
    """Return a sphere about a center (3,)."""
    polar = np.linspace(0, np.pi, _ROUND // 2 + 1)
    ring = _circle()
    normals = np.stack(
        [
            np.outer(np.sin(polar), ring[:, 0]),
            np.outer(np.sin(polar), ring[:, 1]),
            np.repeat(np.cos(polar)[:, None], len(ring), axis=1),
        ],
        axis=-1,
    )
    turn, fall = np.meshgrid(np.linspace(0, 1, len(ring)), polar / np.pi)
    uv = np.stack([turn, fall], axis=-1).reshape(-1, 2)
    flat = normals.reshape(-1, 3)
    return Shape(center + radius * flat, _grid(*normals.shape[:2])[:, ::-1], uv, flat)


def cylinder(start: Floats, end: Floats, radius: float) -> Shape:
    """Return an open cylinder between two points (3,), without texture coordinates."""
    axis = (end - start) / np.linalg.norm(end - start)
    across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    across /= np.linalg.norm(across)
    normals = _circle() @ np.stack([across, np.cross(axis, across)])
    vertices = np.concatenate([start + radius * normals, end + radius * normals])
    return Shape(vertices, _grid(2, len(normals)), None, np.concatenate([normals, normals]))


def _circle() -> Floats:
    """Points (n + 1, 2) around the unit circle; the last is the first again."""
    angle = np.linspace(0, 2 * np.pi, _ROUND + 1)
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _grid(rows: int, columns: int) -> Ints:
    """Two triangles (F, 3) for each cell of a grid of vertices."""
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b = number[:-1, :-1].ravel(), number[:-1, 1:].ravel()
    c, d = number[1:, 1:].ravel(), number[1:, :-1].ravel()
    return np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
