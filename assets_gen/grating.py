"""The 2-D sine grating of the flow benchmark, and a cylinder to carry it (dissertation §4.2.1).

With image coordinates x, y in frames, S = 1 + C·sin(2πf·x_r + φ_x)·sin(2πf·y_r + φ_y). Variant
"rot" turns the coordinates by 45°, x_r = (x + y)/√2 and y_r = (y − x)/√2, as the dissertation
writes; its moving part has √2·f cycles per frame. Variant "periodic" divides by 2 instead and has
exactly f.
"""

from typing import Literal

import numpy as np
import trimesh
from numpy.typing import NDArray

GratingVariant = Literal["rot", "periodic"]


def moving_cycles(cycles_per_frame: float, variant: GratingVariant) -> float:
    """Cycles per frame of the part of the grating that moves with x."""
    return cycles_per_frame * (2**0.5 if variant == "rot" else 1.0)


def sine_grating(
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    contrast: float,
    cycles_per_frame: float,
    phases_rad: tuple[float, float] = (0.0, 0.0),
    variant: GratingVariant = "periodic",
) -> NDArray[np.float64]:
    """Value 1 ± C of the 2-D sine grating at image coordinates x, y (frames)."""
    scale = 2.0 if variant == "periodic" else 2**0.5
    along = 2 * np.pi * cycles_per_frame * (x + y) / scale + phases_rad[0]
    across = 2 * np.pi * cycles_per_frame * (y - x) / scale + phases_rad[1]
    return np.asarray(1 + contrast * np.sin(along) * np.sin(across))


def open_cylinder(radius_m: float, height_m: float, segments: int = 720) -> trimesh.Trimesh:
    """Wall of a vertical cylinder around the origin, normals inward, u = azimuth, v = height."""
    azimuth = np.arange(segments + 1) * (2 * np.pi / segments)
    ring = radius_m * np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    lower, upper = (np.column_stack([ring, np.full(len(ring), z)]) for z in (-0.5, 0.5))
    vertices = np.concatenate([lower, upper]) * [1, 1, height_m]
    u = np.arange(segments + 1) / segments
    uv = np.concatenate([np.column_stack([u, np.full_like(u, v)]) for v in (0.0, 1.0)])
    a = np.arange(segments)
    b, c, d = a + 1, a + segments + 1, a + segments + 2
    faces = np.concatenate([np.column_stack([a, c, b]), np.column_stack([b, c, d])])
    return trimesh.Trimesh(
        vertices, faces, process=False, visual=trimesh.visual.TextureVisuals(uv=uv)
    )
