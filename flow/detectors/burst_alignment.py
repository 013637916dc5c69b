"""Burst alignment (BA): patches of sums of frames, aligned from coarse to fine.

Bursts of photographs, and of binary frames of SPADs, are aligned this way before they are merged
(Hasinoff et al., ACM Trans. Graph. 35(6), 2016; Ma et al., ibid. 39(4), 2020). Each patch of one of
four sums in the middle is searched in the others by the least absolute difference, coarse to fine,
around the shifts of it and its neighbors; a parabola refines the last. The velocity is the slope of
the shifts over time. The field of shifts is not smoothed, unlike in Ma et al.
"""

from typing import ClassVar

import numpy as np

from megalopta.core.arrays import Floats, Ints
from megalopta.core.compiling import compiled
from megalopta.flow.detectors.base import Frames
from megalopta.flow.detectors.blocks import BlockGrid, PooledFrames, block_sums
from megalopta.flow.detectors.poisson_matching import parabola_minimum
from megalopta.flow.likelihood.roots import halved

_COARSEST_RADIUS_PX, _FINER_RADIUS_PX = 4, 2
"""Largest shift searched at the coarsest level (its px), and largest change of it at finer ones"""
_DOWN, _RIGHT = np.array([[0, -1, 1, 0, 0], [0, 0, 0, -1, 1]])
"""Neighbors of a block, itself first"""


class BurstAlignment(PooledFrames, frozen=True):
    """Velocity of each block by alignment of sums of frames."""

    place: ClassVar[float] = 11.5

    name: str = "BA"
    label: str = "Burst alignment"

    def velocities(self, grid: BlockGrid, window: list[Frames]) -> Floats:
        """Return the slopes of the shifts over time, (blocks, 2)."""
        summed = max(1, len(window) // 4)  # frames per sum, for about 4 sums
        count = len(window) // summed
        groups = np.reshape(window[-summed * count :], (count, summed, *grid.shape))
        sums = groups.sum(axis=1, dtype=np.float64)
        middle = (count - 1) // 2
        times = summed * (np.arange(count) - middle)
        slope = sum(
            time * self._shifts(sums[middle], frame, grid)
            for time, frame in zip(times, sums, strict=True)
            if time
        )
        seen = block_sums(sums[middle] - sums.min(), grid).reshape(-1, 1) > 0
        return np.where(seen, slope / (times @ times), np.nan)

    def _shifts(self, reference: Floats, frame: Floats, grid: BlockGrid) -> Floats:
        """Return the displacement of each block's content in another frame, (blocks, 2)."""
        pyramid = [np.stack((reference, frame))]
        # at most 4 levels, each binned by 2 × 2 px more, as long as a block fits
        while len(pyramid) < 4 and min(pyramid[-1].shape[1:]) // 2 >= grid.block_px:
            pyramid.append(halved(pyramid[-1]))
        shifts = np.zeros((grid.rows, grid.columns, 2), np.int64)
        down, right = np.mgrid[: grid.rows, : grid.columns][..., np.newaxis]
        around = np.empty((grid.rows * grid.columns, 3, 3))
        for level, pair in reversed(list(enumerate(pyramid))):
            radius = _FINER_RADIUS_PX if level < len(pyramid) - 1 else _COARSEST_RADIUS_PX
            corners = _corners(grid, level, pair.shape[1:])
            # the shifts of neighbors; at the edge, a block's own
            rows = np.clip(down + _DOWN, 0, grid.rows - 1)
            columns = np.clip(right + _RIGHT, 0, grid.columns - 1)
            guesses = 2 * shifts[rows, columns].reshape(len(corners), -1, 2)
            best = _search(pair, corners, grid.block_px, guesses, radius, around)
            shifts = best.reshape(shifts.shape)
        return np.asarray(best + parabola_minimum(around))


def _corners(grid: BlockGrid, level: int, shape: tuple[int, ...]) -> Ints:
    """Return the upper left corners, (blocks, 2), of patches in the middle of blocks."""
    along = []
    for first, number, side in zip(
        (grid.top, grid.left), (grid.rows, grid.columns), shape, strict=True
    ):
        middles = (first + grid.block_px * (np.arange(number) + 0.5)) / 2**level
        corner = np.floor(middles - grid.block_px / 2).astype(np.int64)
        along.append(np.clip(corner, 0, side - grid.block_px))
    return np.stack(np.meshgrid(*along, indexing="ij"), axis=-1).reshape(-1, 2)


@compiled(fastmath={"reassoc"})
def _difference(pair: Floats, row: int, column: int, size: int, dx: int, dy: int) -> float:
    """Sum of absolute differences of a patch and a displaced one; infinite outside the frame."""
    top, left = row + dy, column + dx
    if top < 0 or left < 0 or top + size > pair.shape[1] or left + size > pair.shape[2]:
        return np.inf
    total = 0.0
    for y in range(size):
        patch = pair[0, row + y, column : column + size]
        displaced = pair[1, top + y, left : left + size]
        for x in range(size):
            total += abs(patch[x] - displaced[x])
    return total


@compiled
def _search(
    pair: Floats, corners: Ints, size: int, guesses: Ints, radius: int, around: Floats
) -> Ints:
    """Return the best shifts (x, y) of patches; fill in the differences around them, (n, 3, 3)."""
    shifts = np.empty((len(corners), 2), np.int64)
    for patch in range(len(corners)):
        row, column = corners[patch, 0], corners[patch, 1]
        least, guess_x, guess_y = np.inf, 0, 0
        for guess in guesses[patch]:
            difference = _difference(pair, row, column, size, guess[0], guess[1])
            if difference < least:
                least, guess_x, guess_y = difference, guess[0], guess[1]
        best_x, best_y = guess_x, guess_y
        for dy in range(guess_y - radius, guess_y + radius + 1):
            for dx in range(guess_x - radius, guess_x + radius + 1):
                difference = _difference(pair, row, column, size, dx, dy)
                if difference < least:
                    least, best_x, best_y = difference, dx, dy
        shifts[patch, 0], shifts[patch, 1] = best_x, best_y
        for i in range(3):
            for j in range(3):
                dx, dy = best_x + j - 1, best_y + i - 1
                around[patch, i, j] = _difference(pair, row, column, size, dx, dy)
    return shifts
