"""Statistics of all pixels of a recording, in one pass over its frames.

Sums of readings and of their products are exact for integers (below 2⁵³), so central moments follow
without a second pass. Frames are read in blocks: they may be mapped from a file.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled

LAGS = 6
"""Largest distance of frames whose covariance is known."""
OFFSETS = ((0, 1), (1, 0), (1, 1), (1, -1), (0, 2), (2, 0))
"""Rows down and columns right of the neighbors whose covariance with a pixel is known."""
BLOCK = 2**24
"""Readings of a block, 128 MiB as float64"""


class Statistics(NamedTuple):
    """Statistics of a recording; maps are (rows, columns)."""

    frames: int
    mean: Floats
    variance: Floats
    """Temporal variance, over n − 1"""
    third: Floats
    """Third central moment"""
    largest: Floats
    at_largest: Floats
    """Number of frames at the pixel's own largest reading"""
    later: Floats
    """Sum of products of deviations from the mean, with frames 1 to 6 later, over n, (6, …)"""
    neighbors: Floats
    """Covariance with the pixel at each of `OFFSETS`, over n − 1, (6, …); 0 where there is none"""
    of_rows: Floats
    """Mean reading of each row of each frame, (frames, rows)"""


def statistics(readings: NDArray[Any]) -> Statistics:
    """Return the statistics of readings (n, rows, columns), n > 6, of any type of numbers."""
    n, *shape = readings.shape
    sums, largest = np.zeros((4, *shape)), np.full(shape, -np.inf)
    later, pairs = np.zeros((2, LAGS, *shape))
    rows = np.empty((n, shape[0]))
    length = max(BLOCK // max(sums[0].size, 1), 4 * LAGS)
    for start in range(0, n, length):
        before = min(start, LAGS)
        block = np.array(readings[start - before : start + length], np.float64)
        _add(block, before, sums, largest, later, pairs, rows[start : start + length])
    mean = sums[0] / n
    second, third = sums[1] / n, sums[2] / n
    ends = np.cumsum([readings[:LAGS], readings[: -LAGS - 1 : -1]], axis=1, dtype=np.float64)
    for lag in range(1, LAGS + 1):  # of the first and last frames, products are not complete
        missing = ends[:, lag - 1].sum(axis=0)
        later[lag - 1] -= mean * (2 * sums[0] - missing) - (n - lag) * mean**2
    for product, offset in zip(pairs, OFFSETS, strict=True):
        pixel, neighbor = both(offset)
        product[pixel] -= n * mean[pixel] * mean[neighbor]
    return Statistics(
        n, mean, np.maximum(second - mean**2, 0) * n / (n - 1),
        third - 3 * mean * second + 2 * mean**3, largest, sums[3], later / n, pairs / (n - 1), rows,
    )  # fmt: skip


def both(offset: tuple[int, int]) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Return the places (rows, columns) of all pixels with a neighbor at an offset, and of it."""
    down, right = offset
    return (
        (slice(0, -down or None), slice(max(-right, 0), -right if right > 0 else None)),
        (slice(down, None), slice(max(right, 0), right if right < 0 else None)),
    )


@compiled(fastmath={"reassoc", "contract"})
def _add(
    block: Floats, before: int, sums: Floats, largest: Floats, later: Floats, pairs: Floats,
    of_rows: Floats,
) -> None:  # fmt: skip
    """Add a block of frames, the first of which have been added before."""
    frames, rows, columns = block.shape
    for row in range(rows):
        for frame in range(before, frames):
            x, total = block[frame, row], 0.0
            for column in range(columns):
                value = x[column]
                total += value
                sums[0, row, column] += value
                sums[1, row, column] += value * value
                sums[2, row, column] += value * value * value
                most, times = largest[row, column], sums[3, row, column]
                sums[3, row, column] = 1.0 if value > most else times + (value == most)
                largest[row, column] = max(most, value)
            of_rows[frame - before, row] = total / columns
            for lag in range(min(frame, later.shape[0])):
                earlier, product = block[frame - 1 - lag, row], later[lag, row]
                for column in range(columns):
                    product[column] += x[column] * earlier[column]
            for number, (down, right) in enumerate(OFFSETS):
                if row + down < rows:
                    below, product = block[frame, row + down], pairs[number, row]
                    for column in range(max(-right, 0), columns - max(right, 0)):
                        product[column] += x[column] * below[column + right]
