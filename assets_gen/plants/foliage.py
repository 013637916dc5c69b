"""Leaves and sprays of needles as folded diamonds of two triangles."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from megalopta.assets_gen import FloatArray, Surface, cross, lengths, unit
from megalopta.assets_gen.plants.branching import UP, sideways
from megalopta.assets_gen.plants.skeleton import IndexArray
from megalopta.assets_gen.plants.species import Foliage

ATLAS_TILES = 8
"""Number of leaves in a row and a column of leaf textures, from old to young in each row."""
TONES = 4
"""Leaf textures, from dark to light, one above the other; each plant shows one of them."""


class Blade(NamedTuple):
    """Shape of a leaf, with fields as in `Foliage`."""

    length_m: float
    width_m: float
    widest: float
    fold_deg: float


def leaf_axes(axes: FloatArray, foliage: Foliage, rng: np.random.Generator) -> FloatArray:
    """Return the side twigs (t, 2, 3) along axes (a, s, 3) (m), or the axes if there are none.

    Twigs are arranged like leaves; one continues from the end of each axis.
    """
    if foliage.twigs is None:
        return axes
    twigs = foliage.twigs
    axis, share, rank = _attachments(axes, foliage.bare, twigs.per_m)
    base, ahead = _along(axes, axis, share)
    turn = np.radians(foliage.divergence_deg) * rank + rng.normal(0, 0.4, len(rank))
    angle = np.where(share < 1, np.radians(twigs.angle_deg), 0.1)[:, None]
    toward = np.cos(angle) * ahead + np.sin(angle) * sideways(ahead, turn) - twigs.droop * UP
    toward = unit(toward + rng.normal(0, 0.15, toward.shape))
    length = twigs.length_m * (1 - 0.5 * share) * rng.uniform(0.6, 1.3, len(share))
    return np.stack([base, base + length[:, None] * toward], axis=1)


def place_leaves(axes: FloatArray, foliage: Foliage, rng: np.random.Generator) -> Surface:
    """Return the leaves along bearing twigs `axes` (a, s, 3) (m), from base to tip of each twig.

    The leaves of a twig are a cluster.
    """
    bare = 0.0 if foliage.twigs else foliage.bare
    axis, share, rank = _attachments(axes, bare, foliage.per_m)
    base, ahead = _along(axes, axis, share)
    turn = np.radians(foliage.divergence_deg) * rank + rng.normal(0, 0.25, len(rank))
    angle = np.radians(foliage.angle_deg)
    direction = np.cos(angle) * ahead + np.sin(angle) * sideways(ahead, turn) - foliage.droop * UP
    direction = unit(direction + rng.normal(0, 0.15, direction.shape))
    normal = UP + foliage.tilt * rng.normal(0, 0.7, direction.shape)
    size = (1 - (1 - foliage.shrink) * share) * rng.uniform(0.75, 1.2, len(share))
    leaves = blades(base, direction, normal, size, foliage, rng, age=1 - share)
    return replace(leaves, clusters=np.repeat(axis + 1, 2))


def _attachments(
    axes: FloatArray, bare: float, per_m: float
) -> tuple[IndexArray, FloatArray, IndexArray]:
    """Return each leaf's axis, position along it (fraction of the length) and rank."""
    length = lengths(np.diff(axes, axis=1)).sum(axis=1)
    count = np.maximum(np.round(length * (1 - bare) * per_m), 2).astype(np.intp)
    axis = np.repeat(np.arange(len(axes)), count)
    rank = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    share = bare + (1 - bare) * (rank + 0.5) / count[axis]
    return axis, np.where(rank == count[axis] - 1, 1.0, share), rank


def _along(axes: FloatArray, axis: IndexArray, share: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the point and the direction at a fraction of the length of each axis."""
    place = share * (axes.shape[1] - 1)
    segment = np.minimum(place.astype(np.intp), axes.shape[1] - 2)
    start, end = axes[axis, segment], axes[axis, segment + 1]
    return start + (place - segment)[:, None] * (end - start), unit(end - start)


def blades(
    base: FloatArray,
    direction: FloatArray,
    facing: FloatArray,
    size: FloatArray,
    foliage: Foliage | Blade,
    rng: np.random.Generator,
    age: FloatArray | None = None,
) -> Surface:
    """Return one folded diamond per leaf, with a random tile of the leaf texture.

    Its base (n, 3) (m), its direction along the midrib, the direction that its upper side faces,
    its size (n,), a factor on length and width, and its age (n,), 0 to 1, are given; null: any.
    """
    across = unit(cross(facing, direction))
    normal = cross(direction, across)
    fold = np.radians(foliage.fold_deg)
    length, half = size[:, None] * foliage.length_m, size[:, None] * foliage.width_m / 2
    middle = base + foliage.widest * length * direction + half * np.sin(fold) * normal
    offset = half * np.cos(fold) * across
    corners = np.stack([base, middle - offset, base + length * direction, middle + offset], axis=1)
    first = 4 * np.arange(len(base))[:, None, None]
    faces = (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    tile = rng.integers(0, ATLAS_TILES, (len(base), 1, 2))
    if age is not None:
        youth = (1 - age + rng.normal(0, 0.2, len(base))).clip(0, 0.99)
        tile[:, 0, 0] = youth * ATLAS_TILES
    w = foliage.widest
    local = np.array([[0.5, 0.02], [0.98, w], [0.5, 0.98], [0.02, w]])
    return Surface(corners.reshape(-1, 3), faces, atlas_uv(tile, local))


def atlas_uv(tile: IndexArray, local: FloatArray) -> FloatArray:
    """Return texture coordinates (n·k, 2) of points (k, 2) in the tiles (n, 1, 2) of leaves."""
    return ((tile + local) / (ATLAS_TILES, ATLAS_TILES * TONES)).reshape(-1, 2)
