"""Image interpolation (IIA), Srinivasan's gradient method for small shifts.

Each block of frame t + 1 is written as a linear interpolation between frame t shifted by one pixel
to either side, and the two coefficients, its velocity, follow by least squares (Srinivasan 1994,
translation only; dissertation §4.3.2). With differences gx = f(x−1) − f(x+1), gy likewise over
rows, and d = f_{t+1} − f_t, summed over the block,

    A = Σgx²   B = Σgx·gy   C = Σgy²   D = Σd·gx   E = Σd·gy
    v_x = 2(CD − BE)/(AC − B²)         v_y = 2(AE − BD)/(AC − B²)

On a sinusoid of k rad/px that moves d px this is sin(kd)/sin k, not d: it holds while the shift is
small against the texture. A block whose gradients have one direction only, or none, has no
velocity (NaN).
"""

from functools import partial
from typing import ClassVar

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled
from megalopta.flow.detectors.base import Frames, Responder, in_pairs
from megalopta.flow.detectors.blocks import BlockDetector, BlockGrid


class ImageInterpolation(BlockDetector, frozen=True):
    """Least-squares velocity of each block from references one pixel to either side."""

    place: ClassVar[float] = 2

    name: str = "IIA"
    label: str = "Image interpolation"

    def start(self, shape: tuple[int, int]) -> Responder:
        """Return the estimator for frames (H, W); see `Detector.start`."""
        return in_pairs(partial(_velocities, self.grid(shape)))

    def scored(self, responses: Floats) -> Floats:
        """Return the x component of the blocks inside: the dissertation's motion is horizontal."""
        return responses[:, 1:-1, 1:-1, :1]


def _velocities(grid: BlockGrid, frames: Frames) -> Floats:
    velocities = np.empty((len(frames) - 1, grid.rows, grid.columns, 2))
    exact = np.ascontiguousarray(frames, np.float64)
    _solve(exact, grid.top, grid.left, grid.block_px, velocities)
    return velocities


@compiled(fastmath={"reassoc"})
def _solve(frames: Floats, top: int, left: int, size: int, velocities: Floats) -> None:
    height, width = frames.shape[1:]
    for pair, i, j in np.ndindex(velocities.shape[:3]):
        A = B = C = D = E = 0.0
        # pixels at the edge of the frame lack a neighbor
        first, last = max(left + j * size, 1), min(left + (j + 1) * size, width - 1)
        for y in range(max(top + i * size, 1), min(top + (i + 1) * size, height - 1)):
            above, below = frames[pair, y - 1, first:last], frames[pair, y + 1, first:last]
            before, behind = frames[pair, y, first - 1 : last - 1], frames[pair, y, first + 1 :]
            frame, next_frame = frames[pair, y, first:last], frames[pair + 1, y, first:last]
            for x in range(last - first):
                gx, gy = before[x] - behind[x], above[x] - below[x]
                change = next_frame[x] - frame[x]
                A += gx * gx
                B += gx * gy
                C += gy * gy
                D += change * gx
                E += change * gy
        determinant = A * C - B * B
        if determinant > 1e-9 * A * C:  # else gradients have one direction
            velocities[pair, i, j, 0] = 2 * (C * D - B * E) / determinant
            velocities[pair, i, j, 1] = 2 * (A * E - B * D) / determinant
        else:
            velocities[pair, i, j] = np.nan
