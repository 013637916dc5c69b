"""Forest floor: small plants (leaves of two triangles each, and grass), loose leaves, trunks."""

import numpy as np

from megalopta.assets_gen import FloatArray, Surface, cross, join, unit
from megalopta.assets_gen.plants.bark import TILE_M
from megalopta.assets_gen.plants.branching import UP, outward
from megalopta.assets_gen.plants.foliage import ATLAS_TILES, Blade, atlas_uv, blades
from megalopta.assets_gen.plants.skeleton import rotation_minimizing_frames, swept_tube

PINNA = Blade(length_m=0.2, width_m=0.055, widest=0.3, fold_deg=8)
HERB_LEAF = Blade(0.14, 0.065, 0.6, 8)
BILBERRY_LEAF = Blade(0.07, 0.04, 0.5, 8)
PETAL = Blade(0.026, 0.018, 0.6, 8)
FALLEN_LEAF = Blade(0.09, 0.055, 0.3, 25)

GRASS_BLADES = 28
"""Blades of a tuft of grass."""


def grow_fern(rng: np.random.Generator) -> Surface:
    """Return a fern of arching fronds, about 0.6 m high and 1.3 m wide."""
    fronds, pairs = 8, 8
    azimuth = 2 * np.pi * (np.arange(fronds) + rng.uniform(-0.3, 0.3, fronds)) / fronds
    length = rng.uniform(0.6, 0.95, fronds)
    share = np.linspace(0.2, 1, pairs)
    point, ahead = _arches(azimuth, length, rng.uniform(0.9, 1.25, fronds), share)
    base, ahead = (np.repeat(x.reshape(-1, 3), 2, axis=0) for x in (point, ahead))
    across = unit(np.cross(ahead, UP))
    side = np.tile([1.0, -1.0], fronds * pairs)[:, None]
    direction = unit(side * across + 0.35 * ahead + rng.normal(0, 0.06, base.shape))
    upper = np.cross(across, ahead) + rng.normal(0, 0.2, base.shape)
    taper = np.repeat(np.sin(np.pi * (0.12 + 0.8 * share)) ** 0.8, 2)
    size = np.tile(taper, fronds) * np.repeat(length, 2 * pairs) / 0.8
    return blades(base, direction, upper, size, PINNA, rng)


def _arches(
    azimuth: FloatArray, length: FloatArray, steep: FloatArray, share: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return points and directions (n, k, 3) along stalks that start at `steep` (rad) and bend."""
    bend = steep[:, None] - 1.5 * share**1.5
    heading = np.cos(bend)[..., None] * outward(azimuth)[:, None] + np.sin(bend)[..., None] * UP
    step = length[:, None] * np.diff(share, prepend=0)
    return np.cumsum(step[..., None] * heading, axis=1), heading


def grow_herbs(rng: np.random.Generator) -> Surface:
    """Return a patch, 0.9 m wide, of low herbs: rosettes of rising leaves."""
    plants, leaves = 14, 5
    spots = 0.28 * rng.standard_normal((plants, 3)) * (1, 1, 0) - 0.02 * UP
    base = np.repeat(spots, leaves, axis=0)
    azimuth, steep = rng.uniform(0, 2 * np.pi, len(base)), rng.uniform(0.3, 1.0, len(base))
    direction = np.cos(steep)[:, None] * outward(azimuth) + np.sin(steep)[:, None] * UP
    facing = UP + rng.normal(0, 0.3, direction.shape)
    size = np.repeat(rng.uniform(0.6, 1.3, plants), leaves) * rng.uniform(0.8, 1.2, len(base))
    return blades(base, direction, facing, size, HERB_LEAF, rng)


def grow_flowers(rng: np.random.Generator) -> tuple[Surface, Surface]:
    """Return the leaves and the petals of a patch, 0.8 m wide, of flowers 0.2 m high."""
    plants, petals = 16, 6
    spots = 0.25 * rng.standard_normal((plants, 3)) * (1, 1, 0)
    azimuth = 2 * np.pi * rng.random((plants, 1)) + 2 * np.pi * np.arange(3) / 3
    base = np.repeat(spots + 0.07 * UP, 3, axis=0)
    leaves = _rosette(base, azimuth.ravel(), 0.35, 0.75 * np.ones(3 * plants), HERB_LEAF, rng)
    heads = spots + rng.uniform(0.13, 0.22, (plants, 1)) * UP
    azimuth = 2 * np.pi * rng.random((plants, 1)) + 2 * np.pi * np.arange(petals) / petals
    size = np.repeat(rng.uniform(0.8, 1.3, plants), petals)
    base = np.repeat(heads, petals, axis=0)
    return leaves, _rosette(base, azimuth.ravel(), 0.25, size, PETAL, rng)


def _rosette(
    base: FloatArray,
    azimuth: FloatArray,
    steep: float,
    size: FloatArray,
    leaf: Blade,
    rng: np.random.Generator,
) -> Surface:
    direction = np.cos(steep) * outward(azimuth) + np.sin(steep) * UP
    facing = UP + rng.normal(0, 0.2, direction.shape)
    return blades(base, direction, facing, size, leaf, rng)


def grow_bilberry(rng: np.random.Generator) -> Surface:
    """Return a low shrub, 0.35 m high and 0.8 m wide: small leaves on upright shoots."""
    shoots, leaves = 22, 7
    foot = 0.2 * rng.standard_normal((shoots, 3)) * (1, 1, 0)
    azimuth, steep = rng.uniform(0, 2 * np.pi, shoots), rng.uniform(0.9, 1.5, shoots)
    length = rng.uniform(0.2, 0.38, shoots)
    share = np.linspace(0.25, 1, leaves)
    point, ahead = _arches(azimuth, length, steep, share)
    base = (foot[:, None] + point).reshape(-1, 3)
    turn = outward(rng.uniform(0, 2 * np.pi, len(base)))
    direction = unit(0.5 * ahead.reshape(-1, 3) + turn)
    facing = UP + rng.normal(0, 0.4, base.shape)
    size = rng.uniform(0.8, 1.3, len(base))
    return blades(base, direction, facing, size, BILBERRY_LEAF, rng)


def grow_grass(rng: np.random.Generator, merged: int = 1) -> Surface:
    """Return a tuft of grass, about 0.4 m high: blades of three triangles that bend outward.

    For a distant view, `merged` blades are drawn as one of their width.
    """
    count = max(round(GRASS_BLADES / merged), 1)
    azimuth = rng.uniform(0, 2 * np.pi, count)
    length, steep = rng.uniform(0.25, 0.6, count), rng.uniform(1.0, 1.5, count)
    point, _ = _arches(azimuth, length, steep, np.array([0.55, 1.0]))
    root = 0.11 * rng.standard_normal((count, 3)) * (1, 1, 0) - 0.03 * UP
    half = 0.006 * GRASS_BLADES / count * outward(azimuth + np.pi / 2)
    middle, tip = root + point[:, 0], root + point[:, 1]
    corners = np.stack([root - half, root + half, middle + half, middle - half, tip], axis=1)
    faces = 5 * np.arange(count)[:, None, None] + np.array([[0, 1, 2], [0, 2, 3], [3, 2, 4]])
    local = np.array([[0.4, 0.02], [0.6, 0.02], [0.6, 0.5], [0.4, 0.5], [0.5, 0.98]])
    uv = atlas_uv(rng.integers(0, ATLAS_TILES, (count, 1, 2)), local)
    return Surface(corners.reshape(-1, 3), faces.reshape(-1, 3), uv)


def strew_litter(rng: np.random.Generator) -> Surface:
    """Return a patch, 1.2 m wide, of loose leaves on level ground."""
    count = 45
    azimuth, heading = rng.uniform(0, 2 * np.pi, (2, count))
    distance = 0.6 * np.sqrt(rng.random((count, 1)))
    base = distance * outward(azimuth) + rng.uniform(0, 0.02, (count, 1)) * UP
    direction = unit(outward(heading) + rng.normal(0.1, 0.2, (count, 1)) * UP)
    facing = UP + rng.normal(0, 0.35, (count, 3))
    return blades(base, direction, facing, rng.uniform(0.6, 1.3, count), FALLEN_LEAF, rng)


def grow_log(rng: np.random.Generator, sides: int = 14) -> tuple[Surface, Surface]:
    """Return bark and end faces of a log along x, 3 to 7 m long, a little sunk in level ground."""
    length, radius = rng.uniform(3, 7), rng.uniform(0.1, 0.2)
    rings = 2 * (sides // 2)
    share = np.linspace(0, 1, rings)
    bend = rng.normal(0, 0.05, 2)
    axis = np.stack(
        [
            length * (share - 0.5),
            length * (bend[0] * np.sin(np.pi * share) + bend[1] * np.sin(2 * np.pi * share)) / 2,
            radius * 0.75 - 0.25 * radius * share,
        ],
        axis=-1,
    )
    thick = radius * (1 - 0.45 * share)
    lumps = 1 + 0.05 * rng.standard_normal((rings, 1)) + 0.03 * rng.standard_normal((rings, sides))
    profile = thick[:, None] * lumps
    tip = axis[-1:] + np.array([[0.01, 0.0, 0.0]])
    trunk = swept_tube(
        np.concatenate([axis, tip]), profile, TILE_M, rng.random(2), whole_tiles=True
    )
    wood = [trunk]
    for _ in range(5):  # broken branches
        at = rng.integers(2, len(axis) - 1)
        turn = rng.uniform(-0.3, np.pi + 0.3)
        toward = unit(np.array([rng.uniform(0.2, 0.9), np.cos(turn), np.sin(turn)]))
        stub_m = thick[at] + rng.uniform(0.08, 0.5)
        line = axis[at] + np.array([0.0, 0.7, 0.95, 1.0])[:, None] * stub_m * toward
        stub_radius = thick[at] * rng.uniform(0.12, 0.3)
        outline = np.repeat(stub_radius * np.array([[1.2], [0.8], [0.7]]), 5, axis=1)
        wood.append(swept_tube(line, outline, TILE_M, rng.random(2), whole_tiles=False))
    # flat faces at both ends, two centimeters outside the bark's own cap
    tangents, normals, _ = rotation_minimizing_frames(axis)
    angle = 2 * np.pi * np.arange(sides) / sides
    index, ends = np.arange(sides), []
    faces = np.stack([np.full_like(index, sides), index, np.roll(index, -1)], axis=-1)
    uv = 0.5 + 0.5 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    for end, sign in ((0, -1), (rings - 1, 1)):
        facing = tangents[end] * sign
        binormal = cross(facing, normals[end])
        circle = np.cos(angle)[:, None] * normals[end] + np.sin(angle)[:, None] * binormal
        center = axis[end] + 0.02 * facing
        rim = center + 0.97 * profile[end].mean() * circle
        ends.append(Surface(np.vstack([rim, center]), faces, np.vstack([uv, [0.5, 0.5]])))
    return join(wood), join(ends)
