"""Image interpolation (IIA), Srinivasan's gradient method for small shifts.

Each block of frame t + 1 is written as a linear interpolation between frame t shifted by one pixel
to either side, and the two coefficients, its velocity, follow by least squares (Srinivasan 1994,
translation only; thesis §4.3.2). With differences gx = f(x−1) − f(x+1), gy likewise over rows, and
d = f_{t+1} − f_t, summed over the block,

    A = Σgx²   B = Σgx·gy   C = Σgy²   D = Σd·gx   E = Σd·gy
    v_x = 2(CD − BE)/(AC − B²)         v_y = 2(AE − BD)/(AC − B²)

On a sinusoid of k rad/px that moves d px this is sin(kd)/sin k, not d: it holds while the shift is
small against the texture. A block whose gradients have one direction only, or none, has no
velocity (NaN).
"""

from functools import partial
from typing import Literal

import numpy as np

from megalopta.flow.block_detector import BlockDetector
from megalopta.flow.blocks import BlockGrid, block_sums
from megalopta.flow.detector import FloatArray, Frames, Responder, in_pairs

_SINGULAR = 1e-9
"""Share of AC below which AC − B² is rounding: gradients of one direction only."""


class ImageInterpolation(BlockDetector, frozen=True):
    """Least-squares velocity of each block from references one pixel to either side."""

    name: str = "IIA"
    """Short name"""

    label: str = "Image interpolation"
    """Name in words"""

    scored_components: Literal["x", "xy"] = "x"
    """What the benchmark compares: the thesis's motion is horizontal, so its x component"""

    def start(self, shape: tuple[int, int]) -> Responder:
        """Return the estimator for frames (H, W); see `Detector.start`."""
        return in_pairs(partial(_velocities, self.grid(shape)))

    def scored(self, responses: FloatArray) -> FloatArray:
        """Return the velocity, by default its x component, of the blocks inside."""
        return responses[:, 1:-1, 1:-1, : len(self.scored_components)]


def _velocities(grid: BlockGrid, frames: Frames) -> FloatArray:
    velocities = np.empty((len(frames) - 1, grid.rows, grid.columns, 2))
    for index in range(len(frames) - 1):
        velocities[index] = _velocity(grid, *frames[index : index + 2].astype(np.float64))
    return velocities


def _velocity(grid: BlockGrid, first: FloatArray, second: FloatArray) -> FloatArray:
    # Pixels at the edge of the frame lack a neighbor; zero takes them out of the sums.
    gx, gy = np.zeros_like(first), np.zeros_like(first)
    np.subtract(first[1:-1, :-2], first[1:-1, 2:], out=gx[1:-1, 1:-1])
    np.subtract(first[:-2, 1:-1], first[2:, 1:-1], out=gy[1:-1, 1:-1])
    change = second - first
    products = (gx * gx, gx * gy, gy * gy, change * gx, change * gy)
    A, B, C, D, E = (block_sums(product, grid) for product in products)
    determinant = A * C - B * B
    solvable = determinant > _SINGULAR * A * C
    divisor = np.where(solvable, determinant, np.nan)
    return np.stack((2 * (C * D - B * E) / divisor, 2 * (A * E - B * D) / divisor), axis=-1)
