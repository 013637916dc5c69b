"""The best shift of each block over a number of frames, from all pairs of frames that far apart."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from megalopta.flow.blocks import BlockGrid
from megalopta.flow.detector import FloatArray
from megalopta.flow.shift_cost import add_costs, best_shift
from megalopta.flow.shot_noise_blur import SmoothedFrame, block_moments, blur_levels


class BlockPairs:
    """A few successive frames whose blocks are to be compared, each at a blur of its own.

    Parameters
    ----------
    window : sequence of frames
        Oldest first, two or more.
    grid
        Blocks of all frames.
    margin_px : int
        How far around a block its texture and noise are judged.
    """

    def __init__(self, window: Sequence[SmoothedFrame], grid: BlockGrid, margin_px: int) -> None:
        self._window = window
        self._grid = grid
        moments = sum(block_moments(frame.counts, grid, margin_px) for frame in window)
        self._levels = blur_levels(np.asarray(moments), len(window)).ravel()
        rows = grid.top + grid.block_px * np.arange(grid.rows)
        columns = grid.left + grid.block_px * np.arange(grid.columns)
        self._corners = np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1).reshape(-1, 2)

    def __len__(self) -> int:
        return len(self._window)

    def neighbors(self, radius: int) -> FloatArray:
        """Return the velocity (x, y) of each block from all pairs of neighbors, (blocks, 2)."""
        return self.shifts(1, np.zeros_like(self._corners), radius)

    def shifts(self, baseline: int, expected: NDArray[np.int64], radius: int) -> FloatArray:
        """Return how far the content of each block moves over `baseline` frames, (blocks, 2).

        Parameters
        ----------
        baseline : int
            Frames from the first to the second of a pair.
        expected : (blocks, 2)
            Shift (x, y) in the middle of the search, px. The block in the second frame of a pair
            is displaced by half of it, as far as the frame goes, so that both stay near.
        radius : int
            Largest difference from the expected shift (px).
        """
        grid, moved = self._grid, expected[:, ::-1]
        last = np.subtract(grid.shape, grid.block_px)
        second_corners = np.clip(self._corners + moved // 2, 0, last)
        costs = np.zeros((len(moved), 2 * radius + 1, 2 * radius + 1))
        for level in np.unique(self._levels):
            mine = np.flatnonzero(self._levels == level)
            part = costs[mine]
            for first, second in zip(
                self._window[:-baseline], self._window[baseline:], strict=True
            ):
                add_costs(
                    first.roots(level),
                    second.roots(level),
                    second.weights(level),
                    (second_corners - moved)[mine],
                    second_corners[mine],
                    grid.block_px,
                    part,
                )
            costs[mine] = part
        return expected + best_shift(costs)
