"""Boxes and balls, with texture coordinates proportional to their surface, and boulders."""

from collections.abc import Callable
from itertools import product

import numpy as np

from megalopta.assets_gen import FloatArray, Surface, cross, grid_corners, join, unit
from megalopta.assets_gen.plants.branching import GOLDEN_ANGLE, UP, outward
from megalopta.assets_gen.plants.skeleton import tube_faces
from megalopta.assets_gen.tileable_noise import plane_waves

_RINGS = 48


def box(extent_m: tuple[float, float, float], tile_m: float) -> Surface:
    """Return a box around the origin with edges along x, y, z; its texture repeats."""
    half, sides = np.array(extent_m) / 2, []
    for normal, sign in product(range(3), (1, -1)):
        across = [(normal + 1) % 3, (normal + 2) % 3]
        square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]][::sign], dtype=float)
        corners = np.zeros((4, 3))
        corners[:, normal] = sign * half[normal]
        corners[:, across] = square * half[across]
        # Each side has its own part of the texture.
        uv = corners[:, across] / tile_m + 0.37 * (2 * normal + (sign > 0))
        sides.append(Surface(corners, np.array([[0, 1, 2], [0, 2, 3]]), uv))
    return join(sides)


def ball(extent_m: tuple[float, float, float], tile_m: float) -> Surface:
    """Return a smooth ball, or ellipsoid, around the origin; arguments as for `box`.

    The texture runs along meridians and parallels and is pinched at the poles (±z).
    """
    half = np.array(extent_m) / 2
    azimuth, polar = np.meshgrid(
        np.linspace(0, 2 * np.pi, 2 * _RINGS + 1), np.linspace(0, np.pi, _RINGS + 1)
    )
    unit = np.stack(
        [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=-1
    ).reshape(-1, 3)
    # An integer number of tiles around, so that the seam is invisible.
    around = max(round(2 * np.pi * float(half[:2].mean()) / tile_m), 1)
    along = np.pi * float(half.mean()) / tile_m
    uv = np.stack([azimuth / (2 * np.pi) * around, (1 - polar / np.pi) * along], axis=-1)
    a, b, c, d = grid_corners(_RINGS + 1, 2 * _RINGS + 1)
    upper = np.column_stack([a, d, b])[2 * _RINGS :]
    lower = np.column_stack([b, d, c])[: -2 * _RINGS]
    normals = unit / half
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Surface(unit * half, np.concatenate([upper, lower]), uv.reshape(-1, 2), normals)


STONE_TILE_M = 1.2
"""Size of one tile of the stone's texture around the boulder (m)."""
ROUNDNESS = 9.0
"""Exponent of the soft minimum over the cutting planes; larger gives sharper edges."""


def grow_rock(rng: np.random.Generator, sides: int = 28) -> Surface:
    """Return a boulder about 1 m wide, its widest part at the ground; scale it to any size.

    In each direction its radius is the soft minimum over a dozen planes, plus weathering; the
    surface is a grid of `sides` meridians, closed at the top, and open only to the ground.
    """
    rings = max(sides // 2, 3)
    elevation = np.linspace(-0.7, np.pi / 2, rings + 1)[:-1, None]
    azimuth = 2 * np.pi * np.arange(sides + 1) / sides
    level, up = np.cos(elevation), np.sin(elevation) * np.ones_like(azimuth)
    grid = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), up], axis=-1)
    top = np.array([[[0.0, 0.0, 1.0]]])
    radius_m = _cut(rng)
    squash = np.array([1.0, rng.uniform(0.65, 1.0), rng.uniform(0.45, 0.85)])
    body, apex = (squash * radius_m(d)[..., None] * d for d in (grid, top))
    body[:, -1] = body[:, 0]
    around = np.concatenate([body[:, -2:-1], body, body[:, 1:2]], axis=1)
    along = np.gradient(body, axis=0)
    normals = unit(cross(around[:, 2:] - around[:, :-2], along))
    u = azimuth / (2 * np.pi) * round(np.pi / STONE_TILE_M)
    uv = np.stack(np.broadcast_arrays(u, elevation / (2 * STONE_TILE_M)), axis=-1)
    return Surface(
        np.concatenate([body.reshape(-1, 3), apex.reshape(-1, 3)]),
        tube_faces(rings, sides),
        np.concatenate([uv.reshape(-1, 2), [[u[-1] / 2, np.pi / 4 / STONE_TILE_M]]]),
        np.concatenate([normals.reshape(-1, 3), top.reshape(-1, 3)]),
    )


def _cut(rng: np.random.Generator) -> Callable[[FloatArray], FloatArray]:
    """Return the radius (...) in directions (..., 3) of a solid cut by planes, with dents (m)."""
    # Evenly spread normals with random deviations: purely random ones would leave some sides uncut.
    level = 1 - (2 * np.arange(14) + 1) / 14
    level_out = np.sqrt(1 - level**2)[:, None] * outward(GOLDEN_ANGLE * np.arange(14))
    even = level_out + np.outer(level, UP)
    planes = unit(even + 0.35 * rng.standard_normal(even.shape))
    dents = [plane_waves((0.25, 1.2), 0.022, 12, rng) for _ in range(3)]
    distances_m = rng.uniform(0.4, 0.58, 14)

    def radius(direction: FloatArray) -> FloatArray:
        toward = np.maximum(direction @ planes.T, 1e-3) / distances_m
        smooth = np.sum(toward**ROUNDNESS, axis=-1) ** (-1 / ROUNDNESS)
        pairs = zip(dents, ([0, 1], [1, 2], [2, 0]), strict=True)
        return np.asarray(smooth + sum(dent(direction[..., pair]) for dent, pair in pairs))

    return radius
