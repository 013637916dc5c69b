"""The velocity at which all frames, laid over one another along it, are most alike.

Where texture x moves by v per frame, the frames f_t(x + v·t), t from their middle, are equal but
for noise. The sum of squared differences from their mean, over the pixels of a block, is least at
the likeliest velocity (roots of counts: `shift_cost`). It is found by Gauss–Newton steps: with g
the mean gradient of the frames so laid,

    Δv = −(Σ_x w·g·gᵀ·Σ_t (t − t̄)²)⁻¹ · Σ_x w·g·Σ_t (t − t̄)·f_t(x + v·t) .

Between pixels frames are cubic splines, which leave of frames blurred by 0.7 px an error below a
hundredth of a pixel, where parabolas through costs leave a tenth.

References
----------
Baker and Matthews (2004), International Journal of Computer Vision 56:221 (steps); Unser (1999),
IEEE Signal Processing Magazine 16:22 (splines).
"""

import math
from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from megalopta.flow.detectors.base import FloatArray
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.detectors.shot_noise_blur import SmoothedFrame, suited_levels

_STEPS, _NEAR_PX = 6, 5e-3
"""Most steps, and the length of one that is the last"""

_FARTHEST_PX = 1.0
"""Between a velocity and where it is moved to; farther away it stays what it was"""


def aligned(
    window: Sequence[SmoothedFrame], grid: BlockGrid, margin_px: int, velocities: FloatArray
) -> FloatArray:
    """Return velocities (blocks, 2) moved to where the frames of a block are most alike.

    Those that would be moved far, or nowhere, and NaN stay.

    Parameters
    ----------
    window : sequence of frames
        Oldest first, two or more.
    grid
        Blocks, in the middle of the frames' time.
    margin_px : int
        How far around a block its texture and noise are judged.
    velocities : (blocks, 2)
        (x, y) to start from, px per frame.
    """
    levels, found, corners = suited_levels(window, grid, margin_px), velocities.copy(), grid.corners
    for level in np.unique(levels):
        mine = np.flatnonzero(levels == level)
        splines = np.stack([frame.splines(level) for frame in window])
        weights = window[len(window) // 2].weights(level)
        found[mine] = _align(splines, weights, corners[mine], grid.block_px, velocities[mine])
    return found


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _align(
    splines: NDArray[np.float32],
    weights: NDArray[np.float32],
    corners: NDArray[np.int64],
    size: int,
    velocities: FloatArray,
) -> FloatArray:
    """Return velocities (n, 2) of blocks at corners, moved."""
    moved = velocities.copy()
    for block, start in enumerate(velocities):
        x, y = start
        for _ in range(_STEPS):
            step_x, step_y = _step(splines, weights, corners[block], size, x, y)
            x, y = x + step_x, y + step_y
            is_near = max(abs(x - start[0]), abs(y - start[1])) <= _FARTHEST_PX  # nor NaN
            if not is_near or step_x**2 + step_y**2 < _NEAR_PX**2:
                break
        if is_near:
            moved[block, 0], moved[block, 1] = x, y
    return moved


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _step(
    splines: NDArray[np.float32],
    weights: NDArray[np.float32],
    corner: NDArray[np.int64],
    size: int,
    vx: float,
    vy: float,
) -> tuple[float, float]:
    """Return a Gauss–Newton step (x, y) of a block's velocity; NaN from NaN."""
    if not (math.isfinite(vx) and math.isfinite(vy)):
        return math.nan, math.nan
    sums = _sums_over_frames(splines, corner, size, vx, vy)
    xx = xy = yy = along_x = along_y = 0.0
    for row in range(size):
        for column in range(size):
            count, times, squares, total, moment, gx, gy = sums[:, row, column]
            if count < 2:
                continue
            weight = weights[corner[0] + row, corner[1] + column]
            gx, gy = gx / count, gy / count
            spread = weight * (squares - times * times / count)
            drift = weight * (moment - times * total / count)
            xx += spread * gx * gx
            xy += spread * gx * gy
            yy += spread * gy * gy
            along_x += drift * gx
            along_y += drift * gy
    determinant = xx * yy - xy * xy
    return (
        (xy * along_y - yy * along_x) / determinant,
        (xy * along_x - xx * along_y) / determinant,
    )


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _sums_over_frames(
    splines: NDArray[np.float32], corner: NDArray[np.int64], size: int, vx: float, vy: float
) -> NDArray[np.float32]:
    """Return what each pixel of a block adds up to over the frames laid over one another.

    1, t, t², f, t·f and the gradient, over the frames in which it lies: (7, size, size).
    """
    frames, height, width = splines.shape
    sums = np.zeros((7, size, size), np.float32)
    lines = np.empty((2, size + 3, size), np.float32)
    for frame in range(frames):
        t = np.float32(frame - (frames - 1) / 2)
        left, across, across_slope = _cubic(vx * t)
        above, down, down_slope = _cubic(vy * t)
        top, bottom = _inside(corner[0] + above, size, height)
        first, last = _inside(corner[1] + left, size, width)
        if top >= bottom or first >= last:
            continue
        for row in range(top, bottom + 3):
            start = corner[1] + left - 1
            for column in range(first, last):
                value = slope = np.float32(0)
                for tap in range(4):
                    spline = splines[frame, corner[0] + above - 1 + row, start + column + tap]
                    value += across[tap] * spline
                    slope += across_slope[tap] * spline
                lines[0, row, column], lines[1, row, column] = value, slope
        for row in range(top, bottom):
            for column in range(first, last):
                value = gx = gy = np.float32(0)
                for tap in range(4):
                    value += down[tap] * lines[0, row + tap, column]
                    gx += down[tap] * lines[1, row + tap, column]
                    gy += down_slope[tap] * lines[0, row + tap, column]
                sums[0, row, column] += 1
                sums[1, row, column] += t
                sums[2, row, column] += t * t
                sums[3, row, column] += value
                sums[4, row, column] += t * value
                sums[5, row, column] += gx
                sums[6, row, column] += gy
    return sums


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _inside(start: int, size: int, length: int) -> tuple[int, int]:
    """Return the first of the pixels from a start that has its four taps, and the one after."""
    return max(0, 1 - start), min(size, length - 2 - start)


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _cubic(shift: float) -> tuple[int, NDArray[np.float32], NDArray[np.float32]]:
    """Return the whole part of a shift, and what four coefficients weigh in value and slope."""
    whole = math.floor(shift)
    f = shift - whole
    g = 1 - f
    value = (g**3 / 6, 2 / 3 - f * f * (2 - f) / 2, 2 / 3 - g * g * (2 - g) / 2, f**3 / 6)
    slope = (-g * g / 2, f * (3 * f - 4) / 2, -g * (3 * g - 4) / 2, f * f / 2)
    return whole, np.array(value, np.float32), np.array(slope, np.float32)
