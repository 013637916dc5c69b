"""Block matching (BM): exhaustive search for the shift with the least mean absolute difference.

Thesis §4.3.1, after Barjatya's ES. Each block of frame t + 1 is compared with all equally large
parts of frame t up to `radius_px` away in x and y; parts that leave the frame are skipped. The
candidates are taken row by row from the upper left, and only a strictly smaller difference
replaces the best, so of equal ones the first wins (in the dark, where all blocks are empty, that
is the velocity (+radius, +radius)). Velocities are whole pixels: motion below half a pixel per
frame reads 0, motion beyond the radius reads wrong.

The candidates have equal areas, so sums stand for means. A sum that exceeds the best is abandoned
after the row of pixels in which it does, which changes nothing in the result. Counts are summed
without rounding up to 2⁵³ in a block.
"""

from functools import partial
from typing import Annotated, ClassVar

import numpy as np
from numba import njit
from pydantic import Field

from megalopta.flow.detectors.base import FloatArray, Frames, Responder, in_pairs
from megalopta.flow.detectors.block_detector import BlockDetector
from megalopta.flow.detectors.blocks import BlockGrid


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
    velocities = np.full((len(frames) - 1, grid.rows, grid.columns, 2), np.nan)
    exact = np.ascontiguousarray(frames, np.float64)
    _search(exact, grid.top, grid.left, grid.block_px, radius, velocities)
    return velocities


# Rows cut out beforehand, and a sum of its own for each, let the compiler vectorize.
@njit(cache=True, nogil=True, fastmath={"reassoc"})  # type: ignore[untyped-decorator]
def _search(
    frames: FloatArray, top: int, left: int, size: int, radius: int, velocities: FloatArray
) -> None:
    height, width = frames.shape[1:]
    for pair, i, j in np.ndindex(velocities.shape[:3]):
        row, column = top + i * size, left + j * size
        best = np.inf
        for dy in range(max(-radius, -row), min(radius, height - size - row) + 1):
            for dx in range(max(-radius, -column), min(radius, width - size - column) + 1):
                cost = 0.0
                for y in range(row, row + size):
                    block = frames[pair + 1, y, column : column + size]
                    candidate = frames[pair, y + dy, column + dx : column + dx + size]
                    row_cost = 0.0
                    for x in range(size):
                        row_cost += abs(block[x] - candidate[x])
                    cost += row_cost
                    if cost >= best:
                        break
                if cost < best:
                    best = cost
                    velocities[pair, i, j, 0] = -dx
                    velocities[pair, i, j, 1] = -dy
