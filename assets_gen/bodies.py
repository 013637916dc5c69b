"""Boxes and balls, with texture coordinates proportional to their surface."""

import numpy as np

from megalopta.assets_gen import FloatArray, Surface, grid_corners, join

_RINGS = 48


def box(extent_m: tuple[float, float, float], tile_m: float) -> Surface:
    """Return a box around the origin with edges along x, y, z; its texture repeats."""
    axes = ((n, (n + 1) % 3, (n + 2) % 3, sign) for n in range(3) for sign in (1, -1))
    return join([_side(np.array(extent_m) / 2, tile_m, *each) for each in axes])


def _side(half: FloatArray, tile_m: float, normal: int, u: int, v: int, sign: int) -> Surface:
    """Return one side, by the axis and the sign of its normal and the axes of its texture."""
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]][::sign], dtype=float)
    corners = np.zeros((4, 3))
    corners[:, normal] = sign * half[normal]
    corners[:, [u, v]] = square * half[[u, v]]
    # Each side has its own part of the texture.
    uv = corners[:, [u, v]] / tile_m + 0.37 * (2 * normal + (sign > 0))
    return Surface(corners, np.array([[0, 1, 2], [0, 2, 3]]), uv)


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


def checkerboard(texels: int = 64) -> FloatArray:
    """Return a texture (texels, texels) of two by two squares, 0 and 1."""
    half = np.arange(texels) < texels // 2
    return np.asarray(half[:, None] ^ half, dtype=float)
