"""The square blocks for which block methods give one velocity each.

The thesis cuts an N × N frame into 10 × 10 blocks. A frame that is not square gets square blocks
of a tenth of its shorter side, as many as fit, centered. Blocks at the border see less of the
motion (the match may have left the frame), so errors are scored on the blocks inside.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

BLOCKS_PER_SIDE = 10
_SMALLEST_BLOCK_PX = 2
FEWEST_BLOCKS = 3
"""Along a side: with less there is no block inside, and nothing to score."""


@dataclass(frozen=True)
class BlockGrid:
    """Where the blocks of a frame of shape (H, W) lie."""

    shape: tuple[int, int]
    block_px: int

    @property
    def rows(self) -> int:
        """Number of blocks above each other."""
        return self.shape[0] // self.block_px

    @property
    def columns(self) -> int:
        """Number of blocks side by side."""
        return self.shape[1] // self.block_px

    @property
    def top(self) -> int:
        """First pixel row of the first block."""
        return self.shape[0] % self.block_px // 2

    @property
    def left(self) -> int:
        """First pixel column of the first block."""
        return self.shape[1] % self.block_px // 2

    @property
    def corners(self) -> NDArray[np.int64]:
        """First pixel row and column of each block, (blocks, 2), row by row."""
        places = np.mgrid[: self.rows, : self.columns].reshape(2, -1).T
        return np.asarray(np.array([self.top, self.left]) + self.block_px * places)

    @property
    def centers(self) -> NDArray[np.float64]:
        """Image coordinates (rows, columns, 2), x and y, of the middles of the blocks."""
        first = self.corners.reshape(self.rows, self.columns, 2)[..., ::-1]
        return np.ascontiguousarray(first, np.float64) + self.block_px / 2


def block_grid(
    shape: tuple[int, int], block_px: int | None = None, fewest_blocks: int = FEWEST_BLOCKS
) -> BlockGrid:
    """Return the blocks of a frame (H, W); by default a tenth of the shorter side wide.

    Raises
    ------
    ValueError
        When there would be fewer blocks along a side, 3 by default, or a block of less than 2 px.
    """
    size = min(shape) // BLOCKS_PER_SIDE if block_px is None else block_px
    if size < _SMALLEST_BLOCK_PX or min(shape) // size < fewest_blocks:
        px = max(size, _SMALLEST_BLOCK_PX)
        least = BLOCKS_PER_SIDE * px if block_px is None else fewest_blocks * px
        raise ValueError(
            f"frames of {shape[0]} × {shape[1]} px cannot be cut into at least {fewest_blocks} ×"
            f" {fewest_blocks} blocks of {px} px: give frames of {least} px or more on a side, or"
            " another block_px (2 px or more)"
        )
    return BlockGrid(shape=shape, block_px=size)


def block_sums(image: NDArray[Any], grid: BlockGrid) -> NDArray[Any]:
    """Return the sum of an image (H, W) over each block, (rows, columns)."""
    size, rows, columns = grid.block_px, grid.rows, grid.columns
    covered = image[grid.top : grid.top + rows * size, grid.left : grid.left + columns * size]
    strips = covered.reshape(rows, size, columns * size).sum(axis=1)
    return np.asarray(strips.reshape(rows, columns, size).sum(axis=2))
