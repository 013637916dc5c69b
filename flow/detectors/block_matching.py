"""Block matching (BM): exhaustive search for the shift with the least mean absolute difference.

Thesis §4.3.1, after Barjatya's ES. Each block of frame t + 1 is compared with all equally large
parts of frame t up to `radius_px` away in x and y; parts that leave the frame are skipped. Of equal
candidates the first, row by row from the upper left, wins: in the dark that is (+radius, +radius).

For each shift in x both frames are laid out in strips as wide as a block, so that a block and each
of its candidates up and down is one run of pixels. Counts are compared as bytes or as 16-bit
numbers where they fit: processors add up |a − b| of 16 to 64 bytes at once.
"""

from collections.abc import Callable
from functools import partial
from typing import Annotated, Any, ClassVar

import numpy as np
from numba import types
from numba.extending import overload
from numpy.typing import NDArray
from pydantic import Field

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled
from megalopta.flow.detectors.base import Frames, Responder, in_pairs
from megalopta.flow.detectors.blocks import BlockDetector, BlockGrid, thesis_radius_px


class BlockMatching(BlockDetector, frozen=True):
    """Whole-pixel velocity of each block by exhaustive search."""

    place: ClassVar[float] = 1

    name: str = "BM"
    label: str = "Block matching"
    radius_px: Annotated[int, Field(ge=1)] | None = None
    """Largest shift searched in x and in y (px per frame); default: `thesis_radius_px`"""

    def start(self, shape: tuple[int, int]) -> Responder:
        """Return the search for frames (H, W); see `Detector.start`."""
        radius = self.radius_px or thesis_radius_px(shape)
        return in_pairs(partial(_velocities, self.grid(shape), radius))


def _velocities(grid: BlockGrid, radius: int, frames: Frames) -> Floats:
    velocities = np.full((len(frames) - 1, grid.rows, grid.columns, 2), np.nan)
    exact = frames.astype(_exact_type(frames, grid.block_px**2), copy=False)
    _search(np.ascontiguousarray(exact), grid.top, grid.left, grid.block_px, radius, velocities)
    return velocities


def _exact_type(frames: Frames, pixels: int) -> type[np.number[Any]]:
    """Return the narrowest type whose differences over `pixels` pixels add up exactly."""
    kind = frames.dtype.kind
    if kind == "u" or (kind == "i" and frames.min(initial=0) >= 0):
        largest = int(frames.max(initial=0))
        for narrow in (np.uint8, np.uint16):
            if largest <= np.iinfo(narrow).max and largest * pixels <= np.iinfo(np.int32).max:
                return narrow
    return np.float64


@compiled
def _search(
    frames: NDArray[Any], top: int, left: int, size: int, radius: int, velocities: Floats
) -> None:
    """Fill in velocities (T − 1, rows, columns, 2) from frames (T, H, W)."""
    count, rows, columns = velocities.shape[:3]
    height, width = frames.shape[1:]
    current = np.empty((columns, height * size), frames.dtype)
    shifted, least = np.empty_like(current), np.empty((rows, columns))
    for pair in range(count):
        _fill_strips(frames[pair + 1], left, current)
        least[:] = np.inf
        for dx in range(-radius, radius + 1):
            _fill_strips(frames[pair], left + dx, shifted)
            for j in range(columns):
                if left + dx + j * size < 0 or left + dx + (j + 1) * size > width:
                    continue
                for i in range(rows):
                    row = top + i * size
                    block = current[j, row * size : (row + size) * size]
                    best = velocities[pair, i, j]
                    for y in range(max(row - radius, 0), min(row + radius, height - size) + 1):
                        cost = _difference(block, shifted[j, y * size : (y + size) * size])
                        # the first in row order, though shifts in x are the outer loop
                        if cost < least[i, j] or (cost == least[i, j] and row - y > best[1]):
                            least[i, j] = cost
                            best[0], best[1] = -dx, row - y


@compiled
def _fill_strips(frame: NDArray[Any], left: int, strips: NDArray[Any]) -> None:
    """Cut a frame (H, W), from a column on, into strips (n, H · width), where they lie inside."""
    height, width = frame.shape
    size = strips.shape[1] // height
    for j in range(len(strips)):
        start = left + j * size
        if start >= 0 and start + size <= width:
            for y in range(height):
                for x in range(size):
                    strips[j, y * size + x] = frame[y, start + x]


def _difference(a: Any, b: Any) -> Any:
    """Return Σ|a − b| of two runs of pixels; compiled code takes what follows instead."""
    return np.abs(np.subtract(a, b, dtype=np.float64)).sum()


@overload(_difference, jit_options={"fastmath": {"reassoc"}})  # type: ignore[untyped-decorator]
def _difference_of(a: Any, b: Any) -> Callable[[Any, Any], Any]:
    def of_counts(a: Any, b: Any) -> Any:
        total = np.int32(0)
        for k in range(a.size):  # of 32 bits in each step: only so one instruction is found for it
            difference = np.int32(np.int32(a[k]) - np.int32(b[k]))
            total = np.int32(total + np.int32(abs(difference)))
        return total

    def of_numbers(a: Any, b: Any) -> Any:
        total = 0.0
        for k in range(a.size):
            total += abs(a[k] - b[k])
        return total

    return of_counts if isinstance(a.dtype, types.Integer) else of_numbers
