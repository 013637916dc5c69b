"""Patterns for motion detectors, and the cylinder and board for them.

The 2-D sine grating of the flow benchmark (dissertation §4.2.1), with image coordinates x, y in
frames: S = 1 + C·sin(2πf·x_r + φ_x)·sin(2πf·y_r + φ_y). Variant "rot" has x_r = (x + y)/√2 and
y_r = (y − x)/√2, as there, and √2·f moving cycles per frame; "periodic" divides by 2, and has f.
"""

from typing import TYPE_CHECKING, Literal

import numpy as np

from megalopta.assets_gen import FloatArray, Surface, grid_faces

if TYPE_CHECKING:
    import trimesh

GratingVariant = Literal["rot", "periodic"]
Pattern = Literal["sine_2d", "sine", "square", "dots"]


def moving_cycles(
    cycles_per_frame: float, variant: GratingVariant, pattern: Pattern = "sine_2d"
) -> float:
    """Cycles per frame of the part of the pattern that moves along x."""
    return cycles_per_frame * (2**0.5 if variant == "rot" and pattern == "sine_2d" else 1.0)


def sine_grating(
    x: FloatArray,
    y: FloatArray,
    contrast: float,
    cycles_per_frame: float,
    phases_rad: tuple[float, float] = (0.0, 0.0),
    variant: GratingVariant = "periodic",
) -> FloatArray:
    """Value 1 ± C of the 2-D sine grating at image coordinates x, y (frames), of any shape."""
    scale = 2.0 if variant == "periodic" else 2**0.5
    along = 2 * np.pi * cycles_per_frame * (x + y) / scale + phases_rad[0]
    across = 2 * np.pi * cycles_per_frame * (y - x) / scale + phases_rad[1]
    return np.asarray(1 + contrast * np.sin(along) * np.sin(across))


def bars(x: FloatArray, contrast: float, phase_rad: float, square: bool) -> FloatArray:
    """Value 1 ± C of vertical bars at places x (periods), of any shape: a sine or a square wave."""
    wave = np.sin(2 * np.pi * x + phase_rad)
    return np.asarray(1 + contrast * (np.where(wave >= 0, 1.0, -1.0) if square else wave))


def random_dots(
    shape: tuple[int, int], size: tuple[float, float], contrast: float, rng: np.random.Generator
) -> FloatArray:
    """Image (H, W) of value 1 + C on disks and 1 − C elsewhere; it tiles without a seam.

    Disks have a diameter of half a period; `size` is the image's height and width in periods.
    """
    radius = 0.25
    count = rng.poisson(np.log(2) / (np.pi * radius**2) * size[0] * size[1])
    texel = np.array(size) / shape
    reach = np.ceil(radius / texel).astype(int)
    rows, columns = np.meshgrid(*(np.arange(-r, r + 1) for r in reach), indexing="ij")
    covered = np.zeros(shape, dtype=bool)
    for center in rng.random((count, 2)) * size:
        nearest = np.floor(center / texel).astype(int)
        row, column = nearest[0] + rows, nearest[1] + columns
        away = np.hypot((row + 0.5) * texel[0] - center[0], (column + 0.5) * texel[1] - center[1])
        inside = away < radius
        covered[row[inside] % shape[0], column[inside] % shape[1]] = True
    return np.where(covered, 1 + contrast, 1 - contrast)


def board(low: FloatArray, high: FloatArray, tile: float) -> "trimesh.Trimesh":
    """Rectangle in the plane z = 0 between two corners (2,), facing −z, with square tiles."""
    corners = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
    vertices = np.column_stack([corners, np.zeros(4)])
    return Surface(vertices, np.array([[0, 2, 1], [0, 3, 2]]), corners / tile).to_mesh()


def open_cylinder(radius_m: float, height_m: float, segments: int = 720) -> "trimesh.Trimesh":
    """Wall of a vertical cylinder around the origin, normals inward, u = azimuth, v = height."""
    azimuth = np.arange(segments + 1) * (2 * np.pi / segments)
    ring = radius_m * np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    lower, upper = (np.column_stack([ring, np.full(len(ring), z)]) for z in (-0.5, 0.5))
    vertices = np.concatenate([lower, upper]) * [1, 1, height_m]
    u = np.arange(segments + 1) / segments
    uv = np.concatenate([np.column_stack([u, np.full_like(u, v)]) for v in (0.0, 1.0)])
    return Surface(vertices, grid_faces(2, segments + 1, inward=True), uv).to_mesh()
