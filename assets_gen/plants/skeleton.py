"""Axes of a plant as a tree of nodes, with their thickness, and tubes swept along them.

Pipe model (Shinozaki et al. 1964, Jpn. J. Ecol. 14:97): every tip is supplied by one pipe of fixed
cross-section that runs down to the root. Pipes of shed leaves stay in the wood: each meter of axis
adds a little area. Cross-sections are carried along by rotation-minimizing frames (double
reflection, Wang et al. 2008, ACM TOG 27:2). Welded by position, a tube is watertight.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from megalopta.assets_gen import FloatArray, Surface, cross, grid_faces, lengths, unit

IndexArray = NDArray[np.intp]


@dataclass(frozen=True)
class Skeleton:
    """Nodes, and the node from which each grew."""

    positions: FloatArray
    """(n, 3): meters, z up."""
    parents: IndexArray
    """(n,): index of the parent, always smaller than the node's own; −1 for a root."""

    def child_counts(self) -> IndexArray:
        """Return the number of nodes that grew from each node, shape (n,)."""
        return np.bincount(self.parents[self.parents >= 0], minlength=len(self.parents))

    def internodes(self) -> FloatArray:
        """Return the vector from parent to node, shape (n, 3), zero at roots (m)."""
        vectors = self.positions - self.positions[self.parents]
        vectors[self.parents < 0] = 0
        return vectors

    def extended(self, positions: FloatArray, parents: IndexArray) -> "Skeleton":
        """Return the skeleton with nodes appended."""
        return Skeleton(
            np.concatenate([self.positions, positions]), np.concatenate([self.parents, parents])
        )

    def with_chain(self, positions: FloatArray) -> "Skeleton":
        """Return the skeleton with one more root and the nodes (n, 3) of a chain from it."""
        parents = len(self.positions) + np.arange(-1, len(positions) - 1)
        parents[0] = -1
        return self.extended(positions, parents)


def sum_toward_root(skeleton: Skeleton, values: FloatArray) -> FloatArray:
    """Return for every node the sum of `values` (n,) over itself and all nodes grown from it."""
    totals = values.astype(float)
    for node in range(len(totals) - 1, 0, -1):
        parent = skeleton.parents[node]
        if parent >= 0:
            totals[parent] += totals[node]
    return totals


def pipe_areas(skeleton: Skeleton, disused_share: float) -> FloatArray:
    """Return the cross-section of every node in pipes of one living tip, shape (n,).

    It is the number of tips above the node plus `disused_share` (1/m), for pipes of shed leaves,
    times the length of axis above it.
    """
    tips = (skeleton.child_counts() == 0).astype(float)
    disused: FloatArray = disused_share * np.linalg.norm(skeleton.internodes(), axis=1)
    return sum_toward_root(skeleton, tips + disused) - disused


def pipe_radii(
    skeleton: Skeleton, disused_share: float, radius_m: float, at_height_m: float
) -> FloatArray:
    """Return the radius of every node (m); the stem's is `radius_m` at `at_height_m`.

    The stem is the first root's thickest axis.
    """
    areas = pipe_areas(skeleton, disused_share)
    stem = axes(skeleton, areas)[0]
    reference = np.interp(at_height_m, skeleton.positions[stem, 2], areas[stem])
    return radius_m * np.sqrt(areas / reference)


def axes(skeleton: Skeleton, thickness: FloatArray) -> list[IndexArray]:
    """Return the axes: node indices from base to tip, each continued by the thickest child.

    A side axis starts at the node that bears it. Every internode belongs to exactly one axis.
    """
    heir = np.full(len(thickness), -1)
    for node, parent in enumerate(skeleton.parents):
        if parent >= 0 and (heir[parent] < 0 or thickness[node] > thickness[heir[parent]]):
            heir[parent] = node
    along = []
    for start, parent in enumerate(skeleton.parents.tolist()):
        if parent < 0 or heir[parent] != start:
            nodes = [start] if parent < 0 else [parent, start]
            while heir[nodes[-1]] >= 0:
                nodes.append(int(heir[nodes[-1]]))
            along.append(np.array(nodes))
    return along


def relaxed(skeleton: Skeleton, passes: int) -> Skeleton:
    """Return the skeleton with kinks relaxed; forks follow their thicker branch, tips stay."""
    counts = skeleton.child_counts()
    inner = (skeleton.parents >= 0) & (counts > 0)
    weight = sum_toward_root(skeleton, np.where(counts == 0, 1.0, 0.0))[:, None] ** 2
    total = _sum_over_children(skeleton.parents, weight)[inner]
    positions = skeleton.positions
    for _ in range(passes):
        ahead = _sum_over_children(skeleton.parents, weight * positions)[inner] / total
        middle = (positions[skeleton.parents[inner]] + ahead) / 2
        positions = positions.copy()
        positions[inner] = (positions[inner] + middle) / 2
    return Skeleton(positions, skeleton.parents)


def _sum_over_children(parents: IndexArray, values: FloatArray) -> FloatArray:
    total = np.zeros_like(values)
    np.add.at(total, parents[parents >= 0], values[parents >= 0])
    return total


_AXES = np.eye(3)


def rotation_minimizing_frames(axis: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return tangents, normals and binormals, each (…, k, 3), along polylines `axis` (…, k, 3)."""
    steps = np.diff(axis, axis=-2)
    headings = unit(steps)
    ends = headings[..., :1, :], headings[..., -1:, :]
    bisectors = headings[..., :-1, :] + headings[..., 1:, :]
    tangents = unit(np.concatenate([ends[0], bisectors, ends[1]], axis=-2))
    helper = _AXES[abs(tangents[..., 0, :]).argmin(axis=-1)]
    normals = np.empty_like(tangents)
    normals[..., 0, :] = unit(cross(tangents[..., 0, :], helper))
    for i in range(steps.shape[-2]):
        step = steps[..., i, :]
        second = tangents[..., i + 1, :] - _reflected(tangents[..., i, :], step)
        normals[..., i + 1, :] = _reflected(_reflected(normals[..., i, :], step), second)
    return tangents, normals, cross(tangents, normals)


def _reflected(vector: FloatArray, direction: FloatArray) -> FloatArray:
    """Return vectors (…, 3) mirrored at the planes perpendicular to `direction` (…, 3)."""
    square = np.vecdot(direction, direction)
    factor = 2 / np.where(square > 1e-20, square, np.inf) * np.vecdot(direction, vector)
    return np.asarray(vector - factor[..., None] * direction)


def swept_tube(
    axis: FloatArray,
    profile: FloatArray,
    tile_m: tuple[float, float],
    uv_origin: FloatArray,
    whole_tiles: bool,
) -> Surface:
    """Return the closed tube around an axis (k, 3) from base to pointed tip (m).

    Its profile (k - 1, sides) is the radius of each ring toward each side (m). Texture tiles have a
    size around and along the tube (m); whole tiles around the base hide the seam. Arrays of n tubes
    give those of n surfaces with the same faces.
    """
    rings, sides = profile.shape[-2:]
    _, normals, binormals = rotation_minimizing_frames(axis)
    angle = 2 * np.pi * np.arange(sides)[:, None] / sides
    first, second = (across[..., :-1, None, :] for across in (normals, binormals))
    spokes = np.cos(angle) * first + np.sin(angle) * second
    grid = axis[..., :-1, None, :] + profile[..., None] * spokes
    base = grid[..., :1, :, :]
    rows = np.concatenate([base, grid, axis[..., -1:, None, :] + np.zeros_like(base)], axis=-3)
    columns = np.concatenate([grid[..., -1:, :], grid, grid[..., :1, :]], axis=-2)
    around = columns[..., 2:, :] - columns[..., :-2, :]
    outward = unit(cross(around, rows[..., 2:, :, :] - rows[..., :-2, :, :]))
    tip = unit(axis[..., -1:, :] - axis[..., -2:-1, :])
    return Surface(
        np.concatenate([_seamed(grid), axis[..., -1:, :]], axis=-2),
        tube_faces(rings, sides),
        tube_uv(axis, profile, tile_m, whole_tiles) + uv_origin[..., None, :],
        np.concatenate([_seamed(outward), tip], axis=-2),
    )


def tube_uv(
    axis: FloatArray, profile: FloatArray, tile_m: tuple[float, float], whole_tiles: bool
) -> FloatArray:
    """Return the texture coordinates of all vertices of tubes, from (0, 0) at their base on."""
    rings, sides = profile.shape[-2:]
    around = 2 * np.pi * (np.add.reduce(profile[..., 0, :], axis=-1) / sides) / tile_m[0]
    turns = np.maximum(np.round(around), 1) if whole_tiles else around
    length = np.zeros(axis.shape[:-1])
    np.cumsum(lengths(np.diff(axis, axis=-2)), axis=-1, out=length[..., 1:])
    length /= tile_m[1]
    walls = np.empty((*axis.shape[:-2], rings, sides + 1, 2))
    walls[..., 0] = np.arange(sides + 1) * (turns / sides)[..., None, None]
    walls[..., -1, 0] = turns[..., None]
    walls[..., 1] = length[..., :-1, None]
    tip = np.stack([turns / 2, length[..., -1]], axis=-1)[..., None, :]
    return np.concatenate([walls.reshape(*axis.shape[:-2], -1, 2), tip], axis=-2)


def _seamed(grid: FloatArray) -> FloatArray:
    seamed = np.concatenate([grid, grid[..., :1, :]], axis=-2)
    return seamed.reshape(*grid.shape[:-3], -1, 3)


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
