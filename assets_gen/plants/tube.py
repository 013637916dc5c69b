"""Round, tapering tubes swept along an axis: trunks, branches and twigs.

The cross-section is carried along by rotation-minimizing frames (double reflection, Wang et al.
2008, ACM TOG 27:2), so that the bark never twists more than its axis. Every tube is closed: a flat
cap at the base, inside the bearing axis or in the ground, and a point at the tip. The column of
vertices at the texture's seam is duplicated; welded by position, a tube is watertight.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from megalopta.assets_gen import FloatArray, Surface, cross, grid_faces, lengths, unit

_AXES = np.eye(3)


def rotation_minimizing_frames(axis: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return tangents, normals and binormals, each (k, 3), along a polyline `axis` (k, 3)."""
    steps = axis[1:] - axis[:-1]
    headings = unit(steps)
    tangents = unit(np.concatenate([headings[:1], headings[:-1] + headings[1:], headings[-1:]]))
    helper = _AXES[abs(tangents[0]).argmin()]
    normals = [unit(cross(tangents[0], helper))]
    for i, step in enumerate(steps):
        second = tangents[i + 1] - _reflected(tangents[i], step)
        normals.append(_reflected(_reflected(normals[i], step), second))
    across = np.array(normals)
    return tangents, across, cross(tangents, across)


def _reflected(vector: FloatArray, direction: FloatArray) -> FloatArray:
    """Return a vector mirrored at the plane perpendicular to `direction`."""
    square = direction @ direction
    return vector - 2 / square * (direction @ vector) * direction if square > 1e-20 else vector


def swept_tube(
    axis: FloatArray,
    profile: FloatArray,
    tile_m: tuple[float, float],
    uv_origin: FloatArray,
    whole_tiles: bool,
) -> Surface:
    """Return the closed tube around an axis.

    Parameters
    ----------
    axis : (k, 3)
        Center line from base to tip (m).
    profile : (k - 1, sides)
        Radius of each ring toward each side (m); the last node of the axis is the pointed tip.
    tile_m : (float, float)
        Size of one texture tile around and along the tube (m).
    uv_origin : (2,)
        Texture coordinates at the start of the tube.
    whole_tiles : bool
        Stretch the texture to an integer number of tiles around the base, which hides the seam.
    """
    rings, sides = profile.shape
    _, normals, binormals = rotation_minimizing_frames(axis)
    angle = 2 * np.pi * np.arange(sides)[:, None] / sides
    spokes = np.cos(angle) * normals[:-1, None] + np.sin(angle) * binormals[:-1, None]
    grid = axis[:-1, None] + profile[..., None] * spokes
    return Surface(
        np.concatenate([_seamed(grid), axis[-1:]]),
        tube_faces(rings, sides),
        tube_uv(axis, profile, tile_m, whole_tiles) + uv_origin,
        np.concatenate([_seamed(_grid_normals(grid, axis)), unit(axis[-1:] - axis[-2:-1])]),
    )


def tube_uv(
    axis: FloatArray, profile: FloatArray, tile_m: tuple[float, float], whole_tiles: bool
) -> FloatArray:
    """Return the texture coordinates of all vertices of a tube, from (0, 0) at its base on."""
    rings, sides = profile.shape
    around = 2 * np.pi * (np.add.reduce(profile[0]) / sides) / tile_m[0]
    turns = max(round(around), 1) if whole_tiles else around
    length = np.zeros(rings + 1)
    np.cumsum(lengths(axis[1:] - axis[:-1]), out=length[1:])
    length /= tile_m[1]
    uv = np.empty((rings * (sides + 1) + 1, 2))
    walls = uv[:-1].reshape(rings, sides + 1, 2)
    walls[..., 0] = np.arange(sides + 1) * (turns / sides)
    walls[:, -1, 0] = turns
    walls[..., 1] = length[:-1, None]
    uv[-1] = turns / 2, length[-1]
    return uv


def _seamed(grid: FloatArray) -> FloatArray:
    return np.concatenate([grid, grid[:, :1]], axis=1).reshape(-1, 3)


def _grid_normals(grid: FloatArray, axis: FloatArray) -> FloatArray:
    rows = np.empty((len(grid) + 2, *grid.shape[1:]))
    rows[0], rows[1:-1], rows[-1] = grid[0], grid, axis[-1]
    columns = np.concatenate([grid[:, -1:], grid, grid[:, :1]], axis=1)
    return unit(cross(columns[:, 2:] - columns[:, :-2], rows[2:] - rows[:-2]))


@lru_cache(maxsize=512)
def tube_faces(rings: int, sides: int) -> NDArray[np.int64]:
    """Return the triangles (N, 3) of a tube: walls between rings, the pointed tip, the base."""
    apex = rings * (sides + 1)
    last = np.arange(apex - sides - 1, apex)
    tip = np.stack([last[:-1], last[1:], np.full(sides, apex)], -1)
    base = [(0, side + 1, side) for side in range(1, sides - 1)]
    faces = np.concatenate([grid_faces(rings, sides + 1), tip, np.array(base)])
    faces.flags.writeable = False  # branches share them
    return faces
