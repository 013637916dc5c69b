"""Block matching (BM): exhaustive search for the shift with the least mean absolute difference.

Thesis §4.3.1, after Barjatya's ES. Each block of frame t + 1 is compared with all equally large
parts of frame t up to `radius_px` away in x and y; parts that leave the frame are skipped. The
candidates are taken row by row from the upper left, and only a strictly smaller difference
replaces the best, so of equal ones the first wins (in the dark, where all blocks are empty, that
is the velocity (+radius, +radius)). Velocities are whole pixels: motion below half a pixel per
frame reads 0, motion beyond the radius reads wrong.

The candidates have equal areas, so sums stand for means. A shift is tried on all blocks of a row at
once: differences of whole lines of pixels are added up line by line, in the narrowest integers that
hold the sum, so that one instruction adds as many as possible, and then block by block. Counts are
summed without rounding up to 2⁵³ in a block.
"""

from functools import partial
from typing import Annotated, Any, ClassVar

import numpy as np
from numba import njit
from numpy.typing import NDArray
from pydantic import Field

from megalopta.flow.detectors.base import FloatArray, Frames, Responder, in_pairs
from megalopta.flow.detectors.block_detector import BlockDetector
from megalopta.flow.detectors.blocks import BlockGrid

_LANES = 64
"""Pixels of the widest vectors, and a multiple of those of all others"""


class BlockMatching(BlockDetector, frozen=True):
    """Whole-pixel velocity of each block by exhaustive search."""

    place: ClassVar[float] = 1

    name: str = "BM"
    """Short name"""

    label: str = "Block matching"
    """Name in words"""

    radius_px: Annotated[int, Field(ge=1)] | None = None
    """Largest shift searched in x and in y (px per frame); by default `thesis_radius_px`"""

    def start(self, shape: tuple[int, int]) -> Responder:
        """Return the search for frames (H, W); see `Detector.start`."""
        radius = self.radius_px or thesis_radius_px(shape)
        return in_pairs(partial(_velocities, self.grid(shape), radius))


def thesis_radius_px(shape: tuple[int, int]) -> int:
    """Return the search radius that grows with the shorter side N of the frame.

    (75 + N)/45, rounded: the thesis's 3, 4, 6 and 7 px at N = 60, 120, 180 and 240.
    """
    return round((75 + min(shape)) / 45)


def _velocities(grid: BlockGrid, radius: int, frames: Frames) -> FloatArray:
    count, height, width = frames.shape
    columns = -(-width // _LANES) * _LANES
    padded = np.zeros((count, height, columns + 2 * radius), _exact_type(frames, grid.block_px))
    padded[:, :, radius : radius + width] = frames
    velocities = np.full((count - 1, grid.rows, grid.columns, 2), np.nan)
    _search(padded, width, grid.top, grid.left, grid.block_px, radius, velocities)
    return velocities


def _exact_type(frames: Frames, lines: int) -> np.dtype[Any]:
    """Return the narrowest type in which so many differences of pixels are added up exactly."""
    if frames.dtype.kind in "ui" and frames.min(initial=0) >= 0:
        largest = int(frames.max(initial=0)) * lines
        if largest < 2**32:
            return np.min_scalar_type(largest)
    return np.dtype(np.float64)


@njit(cache=True, nogil=True, fastmath={"reassoc"})  # type: ignore[untyped-decorator]
def _search(
    padded: NDArray[Any],
    width: int,
    top: int,
    left: int,
    size: int,
    radius: int,
    velocities: FloatArray,
) -> None:
    """Fill in velocities from frames (T, H, radius + columns + radius), the first `width` valid."""
    height, columns = padded.shape[1], padded.shape[2] - 2 * radius
    sums = np.empty(columns, padded.dtype)
    best = np.empty(velocities.shape[2])
    for pair, i in np.ndindex(velocities.shape[:2]):
        row = top + i * size
        best[:] = np.inf
        for dy in range(max(-radius, -row), min(radius, height - size - row) + 1):
            for dx in range(-radius, radius + 1):
                sums[:] = 0
                for y in range(row, row + size):
                    line = padded[pair + 1, y, radius : radius + columns]
                    candidate = padded[pair, y + dy, radius + dx : radius + dx + columns]
                    for x in range(columns):
                        a, b = line[x], candidate[x]
                        sums[x] += a - b if a > b else b - a
                for j in range(best.size):
                    column = left + j * size
                    if column + dx < 0 or column + dx + size > width:
                        continue
                    cost = np.float64(sums[column : column + size].sum())
                    if cost < best[j]:
                        best[j] = cost
                        velocities[pair, i, j, 0] = -dx
                        velocities[pair, i, j, 1] = -dy
