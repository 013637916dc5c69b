"""Block matching by Poisson likelihood, of two frames (PM) or of up to eight together (PPM).

Costs are squared differences of the roots of counts. Each block is smoothed according to its counts
(`roots.suited_blur_px`), and each pixel weighted by the variance of the smoothed roots around it:
texture over texture plus noise, at least 0.2. The best shift is interpolated by the parabola
through 3 × 3 costs, of both frames' parts: where only one's moves, another strip of texture on
either side tilts it. One without photons, or whose costs are all equal, has no velocity (NaN).

PPM first finds the velocity common to all pairs of frames, by a sum of their filtered correlations,
then refines the alignment of the frames by Gauss–Newton steps on cubic splines.

Equations, sources and errors: `docs/theory/matching.md`.
"""

import math
from collections.abc import Sequence
from functools import cache, partial
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.fft import irfft2, next_fast_len, rfft2
from scipy.ndimage import gaussian_filter, spline_filter, uniform_filter

from megalopta.core.arrays import Floats, Ints
from megalopta.core.compiling import compiled
from megalopta.flow.detectors.base import Frames
from megalopta.flow.detectors.blocks import BlockDetector, BlockGrid, PooledFrames, thesis_radius_px
from megalopta.flow.likelihood.roots import root_noise, suited_blur_px

BLURS_PX = (0.7, 1.0, 1.4, 2.0)
"""Standard deviations to choose from. Less than 0.7 px leaves too little to interpolate between
pixels, more than 2 px reaches far out of a block."""

_LEAST_WEIGHT = 0.2

_STEPS_PER_PX = 2
"""Velocities tried, before interpolation"""
_SLOPE, _LARGEST_PATTERN = 2.6, 0.02
"""S is proportional to (ω² + 0.02)^−1.3, ω in rad/px: between dead leaves and photographs"""
_STEPS, _NEAR_PX = 6, 5e-3
"""Most steps, and the length at which they stop"""


class PoissonMatching(BlockDetector, frozen=True):
    """Velocity of each block by the likelihood of its counts in two frames."""

    place: ClassVar[float] = 12
    ignores_offset: ClassVar[bool] = False
    takes_counts: ClassVar[bool] = True

    name: str = "PM"
    label: str = "Poisson matching"
    radius_px: Annotated[int, Field(ge=1)] | None = None
    """Largest shift searched in x and in y (px per frame); default: as block matching"""

    def prepared(self, grid: BlockGrid, frame: Frames) -> Any:
        """Return a frame, smoothed on demand."""
        return SmoothedFrame(self.as_counts(frame))

    def velocities(self, grid: BlockGrid, window: list[Any]) -> Floats:
        """Return the most likely shifts between two frames, NaN if all are equally likely.

        The radius is also the margin around a block in which its texture and noise are measured.
        """
        (first, second), radius, seconds = window, self._radius(grid), grid.corners
        levels = suited_levels(window, grid, radius)
        size = grid.block_px
        costs = _costs((first, second), levels, np.hstack((seconds, seconds)), size, radius)
        y, x = np.divmod(costs.reshape(len(costs), -1).argmin(axis=1), 2 * radius + 1)
        best = np.stack((x, y), axis=-1) - radius
        # none if all costs are equal, as without photons, or none is finite
        highest = np.where(np.isfinite(costs), costs, -np.inf).max(axis=(1, 2))
        exists = (highest > costs.min(axis=(1, 2)))[:, np.newaxis]
        firsts = np.where(exists, seconds - best[:, ::-1], seconds)
        forth = _costs((first, second), levels, np.hstack((firsts, seconds)), size, 1)
        back = _costs((second, first), levels, np.hstack((seconds, firsts)), size, 1)
        shifts = best + parabola_minimum(forth + back[:, ::-1, ::-1])
        return np.where(exists, shifts, np.nan)

    def _radius(self, grid: BlockGrid) -> int:
        return self.radius_px or thesis_radius_px(grid.shape)


class SmoothedFrame:
    """A frame of counts, smoothed on demand, by `BLURS_PX` of a level."""

    def __init__(self, counts: Frames) -> None:
        self._counts = counts.astype(np.float32)
        self.moments = cache(partial(block_moments, self._counts))
        """`block_moments` of the counts by grid and margin"""
        self.roots = cache(lambda level: np.sqrt(_smooth(self._counts, level).clip(0)))
        """Roots of the smoothed counts, (H, W), by level"""
        self.splines = cache(lambda level: spline_filter(self.roots(level), 3, output=np.float32))
        """Coefficients of cubic splines through `roots`, (H, W), by level"""
        self.weights = cache(self._weights)
        """Texture around each pixel of `roots`, from 0.2 to 1, (H, W), by level"""

    def _weights(self, level: int) -> NDArray[np.float32]:
        side = round(12 * BLURS_PX[level]) | 1  # px in which texture is measured, odd
        roots = self.roots(level)
        variance = uniform_filter((roots - uniform_filter(roots, side)) ** 2, side)
        texture = np.maximum(variance - _ROOT_NOISE[level], 0)
        share = texture / (texture + _ROOT_NOISE[level])
        return np.asarray(np.float32(_LEAST_WEIGHT) + (1 - _LEAST_WEIGHT) * share)


def suited_levels(
    window: Sequence[SmoothedFrame], grid: BlockGrid, margin_px: int
) -> NDArray[np.intp]:
    """Return the index in `BLURS_PX` of each block, (blocks,), from it and a margin."""
    pixels, total, squares = np.sum([frame.moments(grid, margin_px) for frame in window], axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        excess = np.nan_to_num((squares - total**2 / pixels) / total - 1)
    steps = np.log(suited_blur_px(excess, len(window)))[..., np.newaxis] - np.log(BLURS_PX)
    return np.asarray(np.abs(steps).argmin(axis=-1)).ravel()


def block_moments(counts: Frames, grid: BlockGrid, margin_px: int) -> Floats:
    """Return sums of 1, counts and squared counts over blocks and a margin, (3, rows, columns)."""
    around = np.array([[-margin_px], [grid.block_px + margin_px]])
    rows, columns = (
        np.clip(first + grid.block_px * np.arange(number) + around, 0, side)
        for first, number, side in zip(
            (grid.top, grid.left), (grid.rows, grid.columns), counts.shape, strict=True
        )
    )
    exact, sums = counts.astype(np.float64), []
    for image in (exact, exact**2):
        below = np.pad(image, ((1, 0), (0, 0))).cumsum(axis=0)
        beside = np.pad(below[rows[1]] - below[rows[0]], ((0, 0), (1, 0))).cumsum(axis=1)
        sums.append(beside[:, columns[1]] - beside[:, columns[0]])
    return np.stack((np.multiply.outer(rows[1] - rows[0], columns[1] - columns[0]), *sums))


def _smooth(counts: NDArray[Any], level: int) -> NDArray[Any]:
    return np.asarray(gaussian_filter(counts, BLURS_PX[level], mode="reflect", truncate=3.0))


_ROOT_NOISE = [
    np.float32(root_noise(partial(_smooth, level=level))) for level in range(len(BLURS_PX))
]


# A separate sum for each row, cut out beforehand, lets the compiler vectorize.
@compiled(fastmath={"reassoc", "contract"})
def add_costs(
    first: NDArray[np.float32],
    second: NDArray[np.float32],
    weights: NDArray[np.float32],
    places: Ints,
    size: int,
    costs: Floats,
) -> None:
    """Add Σ weight·(second − first)² over blocks of `second` and parts of `first` to costs.

    `first`, `second`, `weights` (H, W): roots of smoothed counts, and weights of those of `second`.
    `places` (n, 4): row and column in `first` of the origin, and of each block in `second`. Entry
    [radius + dy, radius + dx] of `costs` (n, 2·radius + 1, 2·radius + 1) compares with the part dx
    to the *left* and dy *above* the origin: content that moved by (+dx, +dy). Parts that leave the
    frame cost infinity.
    """
    height, width = first.shape
    radius = costs.shape[1] // 2
    for block in range(len(places)):
        origin_row, origin_column, row, column = places[block]
        for dy in range(-radius, radius + 1):
            for dx in range(-radius, radius + 1):
                top, left = origin_row - dy, origin_column - dx
                if top < 0 or left < 0 or top + size > height or left + size > width:
                    costs[block, radius + dy, radius + dx] = np.inf
                    continue
                cost = np.float32(0)
                for y in range(size):
                    part = second[row + y, column : column + size]
                    weight = weights[row + y, column : column + size]
                    shifted = first[top + y, left : left + size]
                    row_cost = np.float32(0)
                    for x in range(size):
                        difference = part[x] - shifted[x]
                        row_cost += weight[x] * difference * difference
                    cost += row_cost
                costs[block, radius + dy, radius + dx] += cost


def parabola_minimum(costs: Floats) -> Floats:
    """Return the minimum (x, y) of the parabola through costs (n, 3, 3), (n, 2), at most 1 away.

    0 along an axis on which a cost is infinite or the middle is no minimum.
    """
    c = {(i, j): costs[:, 1 + i, 1 + j] for i in (-1, 0, 1) for j in (-1, 0, 1)}
    with np.errstate(invalid="ignore", divide="ignore"):
        fx, fxx = (c[0, 1] - c[0, -1]) / 2, c[0, 1] - 2 * c[0, 0] + c[0, -1]
        fy, fyy = (c[1, 0] - c[-1, 0]) / 2, c[1, 0] - 2 * c[0, 0] + c[-1, 0]
        fxy = (c[1, 1] - c[1, -1] - c[-1, 1] + c[-1, -1]) / 4
        determinant = fxx * fyy - fxy**2
        coupled = determinant > 0.05 * fxx * fyy  # else meaningless across an edge
        x = np.where(coupled, (fxy * fy - fyy * fx) / determinant, -fx / fxx)
        y = np.where(coupled, (fxy * fx - fxx * fy) / determinant, -fy / fyy)
        steps = np.where(np.stack((fxx, fyy), axis=-1) > 0, np.stack((x, y), axis=-1), 0)
    return np.where(np.isfinite(steps), np.clip(steps, -1, 1), 0)


def _costs(
    pair: tuple[SmoothedFrame, SmoothedFrame],
    levels: NDArray[np.intp],
    places: Ints,
    block_px: int,
    radius: int,
) -> Floats:
    """Return the costs of shifts around those of places, as of `add_costs`."""
    costs = np.zeros((len(places), 2 * radius + 1, 2 * radius + 1))
    for level in np.unique(levels):
        blocks = np.flatnonzero(levels == level)
        at_level = costs[blocks]
        roots, weights = (frame.roots(level) for frame in pair), pair[1].weights(level)
        add_costs(*roots, weights, places[blocks], block_px, at_level)
        costs[blocks] = at_level
    return costs


class PooledMatching(PooledFrames, PoissonMatching, frozen=True):
    """Velocity of each block by the likelihood of its counts in several frames.

    Blocks move with the content: each is at its place in the middle of the frames' time. Velocities
    are those of the newest pair, assuming no acceleration since the oldest frame; at the start of a
    sequence there are fewer frames to pool.
    """

    place: ClassVar[float] = 13

    name: str = "PPM"
    label: str = "Pooled Poisson matching"

    def prepared(self, grid: BlockGrid, frame: Frames) -> "tuple[SmoothedFrame, Patches]":
        """Return a frame, smoothed on demand, and the spectra around its blocks."""
        counts = self.as_counts(frame)
        return SmoothedFrame(counts), Patches(counts, grid, self._radius(grid))

    def velocities(self, grid: BlockGrid, window: "list[tuple[SmoothedFrame, Patches]]") -> Floats:
        """Return the velocities of best alignment of all frames, near those common to all pairs."""
        (smoothed, patches), radius = zip(*window, strict=True), self._radius(grid)
        return aligned(smoothed, grid, radius, agreed_velocities(patches, radius))


class Patches:
    """Spectra of the counts of one frame (H, W) around each block, with a margin."""

    def __init__(self, counts: Frames, grid: BlockGrid, margin_px: int) -> None:
        self.side = grid.block_px + 2 * margin_px
        size = next_fast_len(2 * self.side, real=True)
        cut = np.zeros((grid.rows * grid.columns, size, size), np.float32)
        self.moments = block_moments(counts, grid, margin_px).reshape(3, -1)
        for patch, (top, left) in zip(cut, grid.corners, strict=True):
            rows, columns = (
                slice(max(first - margin_px, 0), first + grid.block_px + margin_px)
                for first in (top, left)
            )
            seen = counts[rows, columns].astype(np.float64)
            patch[: seen.shape[0], : seen.shape[1]] = seen - seen.mean()
        self.spectra: NDArray[np.complex64] = rfft2(cut)


def agreed_velocities(frames: Sequence[Patches], radius_px: int) -> Floats:
    """Return the most likely velocity (x, y) of each patch, (patches, 2), px per frame.

    NaN if all are equally likely: fewer than two of its frames show any pattern. Frames are oldest
    first, two or more; velocities are tried up to a radius in x and in y.
    """
    pixels, total, squares = np.sum([frame.moments for frame in frames], axis=0)
    count, size = len(frames), frames[0].spectra.shape[1]
    omega = 2 * math.pi * np.hypot(np.fft.fftfreq(size)[:, np.newaxis], np.fft.rfftfreq(size))
    shape = (omega**2 + _LARGEST_PATTERN) ** (-_SLOPE / 2)
    steps = radius_px * _STEPS_PER_PX
    scores = np.zeros((2 * steps + 1, 2 * steps + 1))
    velocities = np.full((len(pixels), 2), np.nan)
    for patch in np.flatnonzero(total):
        noise = total[patch] / pixels[patch]
        excess = squares[patch] / pixels[patch] - noise**2 - noise
        excess = max(excess, (0.1 * noise) ** 2)  # contrast of at least 0.1
        # S/(N·(N + n·S)), with S of this variance, which is the mean power
        spectrum = excess * shape * size**2 / (2 * shape.sum())
        weight = np.asarray(spectrum / (noise * (noise + count * spectrum)), np.float32)
        seen = np.stack([frame.spectra[patch] for frame in frames])
        crosses = [np.sum(seen[:-lag].conj() * seen[lag:], axis=0) for lag in range(1, count)]
        correlations = irfft2(np.stack(crosses) * weight, (size, size))
        add_up_pairs(correlations, frames[0].side, scores)
        if np.ptp(scores) > 0:
            # between the velocities tried, by a parabola
            best = np.array(np.unravel_index(scores.argmax(), scores.shape))
            around = np.full((1, 3, 3), np.inf)
            if (best > 0).all() and (best < 2 * steps).all():
                around[0] = -scores[best[0] - 1 : best[0] + 2, best[1] - 1 : best[1] + 2]
            velocities[patch] = (best[::-1] - steps + parabola_minimum(around)[0]) / _STEPS_PER_PX
    return velocities


@compiled
def add_up_pairs(correlations: NDArray[np.float32], side: int, scores: Floats) -> None:
    """Add up, for each velocity, the correlations of frames k apart at k times it."""
    size, middle = correlations.shape[1], len(scores) // 2
    for i in range(len(scores)):
        for j in range(len(scores)):
            total = 0.0
            for before in range(len(correlations)):
                x = (j - middle) * (before + 1) / _STEPS_PER_PX
                y = (i - middle) * (before + 1) / _STEPS_PER_PX
                if abs(x) >= side or abs(y) >= side:  # no overlap
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


def aligned(
    window: Sequence[SmoothedFrame], grid: BlockGrid, margin_px: int, velocities: Floats
) -> Floats:
    """Return velocities (blocks, 2), x and y in px per frame, refined to the best alignment.

    Velocities with a large or undefined refinement, and NaN, are kept. Frames are oldest first, two
    or more; blocks are in the middle of the frames' time, and their texture and noise are measured
    with the margin around them.
    """
    levels, refined = suited_levels(window, grid, margin_px), velocities.copy()
    for level in np.unique(levels):
        blocks = np.flatnonzero(levels == level)
        splines = np.stack([frame.splines(level) for frame in window])
        weights = window[len(window) // 2].weights(level)
        corners = grid.corners[blocks]
        refined[blocks] = _align(splines, weights, corners, grid.block_px, velocities[blocks])
    return refined


@compiled
def _align(
    splines: NDArray[np.float32],
    weights: NDArray[np.float32],
    corners: Ints,
    size: int,
    velocities: Floats,
) -> Floats:
    """Return refined velocities (n, 2) of blocks at corners, by Gauss–Newton steps."""
    refined = velocities.copy()
    for block, (start_x, start_y) in enumerate(velocities):
        if not (math.isfinite(start_x) and math.isfinite(start_y)):
            continue
        corner, vx, vy = corners[block], start_x, start_y
        for _ in range(_STEPS):
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
            step_x = (xy * along_y - yy * along_x) / determinant
            step_y = (xy * along_x - xx * along_y) / determinant
            vx, vy = vx + step_x, vy + step_y
            is_near = max(abs(vx - start_x), abs(vy - start_y)) <= 1.0  # px; false for NaN
            if not is_near or step_x**2 + step_y**2 < _NEAR_PX**2:
                break
        if is_near:
            refined[block, 0], refined[block, 1] = vx, vy
    return refined


@compiled
def _sums_over_frames(
    splines: NDArray[np.float32], corner: Ints, size: int, vx: float, vy: float
) -> NDArray[np.float32]:
    """Return Σ over the frames of 1, t, t², f, t·f and the gradient at pixels, (7, size, size)."""
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


@compiled
def _inside(start: int, size: int, length: int) -> tuple[int, int]:
    """Return the first of the pixels from a start that has its four taps, and the one after."""
    return max(0, 1 - start), min(size, length - 2 - start)


@compiled
def _cubic(shift: float) -> tuple[int, NDArray[np.float32], NDArray[np.float32]]:
    """Return the integer part of a shift, and four coefficients' weights for value and slope."""
    integer = math.floor(shift)
    f = shift - integer
    g = 1 - f
    value = (g**3 / 6, 2 / 3 - f * f * (2 - f) / 2, 2 / 3 - g * g * (2 - g) / 2, f**3 / 6)
    slope = (-g * g / 2, f * (3 * f - 4) / 2, -g * (3 * g - 4) / 2, f * f / 2)
    return integer, np.array(value, np.float32), np.array(slope, np.float32)
