"""Poisson matching pooled over up to eight frames of one velocity (PPM).

n frames of a texture that moves steadily tell its velocity v with a variance of no less than
1/(J·Σ(t − t̄)²), which is 2/J for two frames and 1/(42·J) for eight. Two steps come near it.

**All pairs of frames** are searched for the velocity that they agree on. If the texture of a patch
is a draw of a Gaussian process of power spectrum S(ω), moves by v per frame, and is seen n times
with white noise of variance N, the log-likelihood of v is, up to a constant (the texture integrated
out; `flow.metrics.translation_bound`),

    ½·Σ_ω S/(N·(N + n·S))·|Σ_t y_t(ω)·exp(iω·v·t)|²

whose part that depends on v is a sum over pairs of frames: their correlation, filtered, at the
displacement v·k of frames k apart. So frames count together of which no two alone show more than
noise. N is the mean count, S falls with the frequency from the counts' excess variance. Pairs
overlap less the farther they are displaced, and tell as much less. Neither the edge of a patch nor
texture that is no Gaussian process enters, which costs precision where photons abound.

From there **the frames are laid over one another**, and the velocity at which they are most alike
is found to fractions of a pixel. Where texture x moves by v per frame, the frames f_t(x + v·t), t
from their middle, are equal but for noise. The sum of squared differences of roots from their mean,
over the pixels of a block, is least at the likeliest velocity. It is found by Gauss–Newton steps:
with g the mean gradient of the frames so laid,

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
from typing import ClassVar

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.fft import irfft2, next_fast_len, rfft2

from megalopta.flow.detectors.base import FloatArray, Frames, Responder
from megalopta.flow.detectors.blocks import BlockGrid, PooledFrames, thesis_radius_px
from megalopta.flow.detectors.poisson_matching import (
    PoissonMatching,
    SmoothedFrame,
    parabola_minimum,
    suited_levels,
)

_STEPS_PER_PX = 2
"""Velocities tried, before interpolation"""

_SLOPE, _LARGEST_PATTERN = 2.6, 0.02
"""S goes as (ω² + 0.02)^−1.3, ω in rad/px: between dead leaves and photographs"""

_LEAST_CONTRAST = 0.1

_STEPS, _NEAR_PX = 6, 5e-3
"""Most steps, and the length of one that is the last"""

_FARTHEST_PX = 1.0
"""Between a velocity and where it is moved to; farther away it stays what it was"""


class PooledMatching(PooledFrames, PoissonMatching, frozen=True):
    """Velocity of each block by the likelihood of its counts in several frames.

    Blocks ride with the content: each lies at its place in the middle of the frames' time.
    Velocities are those of the newest pair under the assumption that nothing has accelerated since
    the oldest frame; at the start of a sequence there are fewer frames to pool.
    """

    place: ClassVar[float] = 13

    name: str = "PPM"
    label: str = "Pooled Poisson matching"

    def start(self, shape: tuple[int, int]) -> Responder:
        """Return the search for frames (H, W); see `Detector.start`."""
        grid, radius = self.grid(shape), self.radius_px or thesis_radius_px(shape)

        def prepared(frame: Frames) -> tuple[SmoothedFrame, Patches]:
            return SmoothedFrame(frame), Patches(frame, grid, radius)

        def velocity(window: list[tuple[SmoothedFrame, Patches]], scale: float) -> FloatArray:
            smoothed, patches = zip(*window, strict=True)
            return aligned(smoothed, grid, radius, agreed_velocities(patches, radius))

        return self.over_window(grid, velocity, prepared)


class Patches:
    """Spectra of the counts of one frame around each block.

    Parameters
    ----------
    counts : (H, W)
    grid
        Blocks.
    margin_px : int
        How far around a block a patch reaches, as far as the frame goes.
    """

    def __init__(self, counts: Frames, grid: BlockGrid, margin_px: int) -> None:
        self.side = grid.block_px + 2 * margin_px
        size = next_fast_len(2 * self.side, real=True)
        cut = np.zeros((grid.rows * grid.columns, size, size), np.float32)
        self.moments = np.empty((3, len(cut)))
        """Sums of 1, counts and squared counts"""
        for index, (top, left) in enumerate(grid.corners):
            rows, columns = (
                slice(max(first - margin_px, 0), first + grid.block_px + margin_px)
                for first in (top, left)
            )
            seen = counts[rows, columns].astype(np.float64)
            self.moments[:, index] = seen.size, seen.sum(), np.sum(seen**2)
            cut[index, : seen.shape[0], : seen.shape[1]] = seen - seen.mean()
        self.spectra: NDArray[np.complex64] = rfft2(cut)


def agreed_velocities(frames: Sequence[Patches], radius_px: int) -> FloatArray:
    """Return the most likely velocity (x, y) of each patch, (patches, 2), px per frame.

    NaN where all are as likely: fewer than two of its frames show any pattern.

    Parameters
    ----------
    frames
        Oldest first, two or more.
    radius_px : int
        Largest velocity tried in x and in y.
    """
    pixels, total, squares = np.sum([each.moments for each in frames], axis=0)
    size = frames[0].spectra.shape[1]
    steps = radius_px * _STEPS_PER_PX
    scores = np.zeros((2 * steps + 1, 2 * steps + 1))
    velocities = np.full((len(pixels), 2), np.nan)
    for patch in np.flatnonzero(total):
        mean = total[patch] / pixels[patch]
        excess = squares[patch] / pixels[patch] - mean**2 - mean
        weight = pair_weight(size, max(excess, (_LEAST_CONTRAST * mean) ** 2), mean, len(frames))
        seen = np.stack([each.spectra[patch] for each in frames])
        crosses = [
            np.sum(seen[:-apart].conj() * seen[apart:], axis=0) for apart in range(1, len(frames))
        ]
        correlations = irfft2(np.stack(crosses) * weight, (size, size))
        add_up_pairs(correlations, frames[0].side, scores)
        if np.ptp(scores) > 0:
            velocities[patch] = _peak(scores)
    return velocities


def pair_weight(size: int, excess: float, noise: float, frames: int) -> NDArray[np.float32]:
    """Return S/(N·(N + n·S)) at the frequencies of `rfft2`."""
    omega = 2 * math.pi * np.hypot(np.fft.fftfreq(size)[:, np.newaxis], np.fft.rfftfreq(size))
    shape = (omega**2 + _LARGEST_PATTERN) ** (-_SLOPE / 2)
    spectrum = excess * shape * size**2 / (2 * shape.sum())  # the variance is the mean power
    return np.asarray(spectrum / (noise * (noise + frames * spectrum)), np.float32)


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def add_up_pairs(correlations: NDArray[np.float32], side: int, scores: FloatArray) -> None:
    """Add up, for each velocity, the correlations of frames k apart at k times it."""
    size, middle = correlations.shape[1], len(scores) // 2
    for i in range(len(scores)):
        for j in range(len(scores)):
            total = 0.0
            for before in range(len(correlations)):
                x = (j - middle) * (before + 1) / _STEPS_PER_PX
                y = (i - middle) * (before + 1) / _STEPS_PER_PX
                if abs(x) >= side or abs(y) >= side:  # nothing overlaps
                    break
                left, above = math.floor(x), math.floor(y)
                a, b = x - left, y - above
                image = correlations[before]
                total += (1 - b) * (
                    (1 - a) * image[above % size, left % size]
                    + a * image[above % size, (left + 1) % size]
                ) + b * (
                    (1 - a) * image[(above + 1) % size, left % size]
                    + a * image[(above + 1) % size, (left + 1) % size]
                )
            scores[i, j] = total


def _peak(scores: FloatArray) -> FloatArray:
    """Return the velocity (x, y) of the highest score, between those tried by a parabola."""
    steps = len(scores) // 2
    best = np.array(np.unravel_index(scores.argmax(), scores.shape))
    around = np.full((1, 3, 3), np.inf)
    if (best > 0).all() and (best < 2 * steps).all():
        around[0] = -scores[best[0] - 1 : best[0] + 2, best[1] - 1 : best[1] + 2]
    return np.asarray((best[::-1] - steps + parabola_minimum(around)[0]) / _STEPS_PER_PX)


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
