"""The best shift of each block over a number of frames, from all pairs of frames that far apart."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from megalopta.flow.detectors.base import FloatArray
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.detectors.shift_cost import add_costs, least_cost, parabola_minimum
from megalopta.flow.detectors.shot_noise_blur import SmoothedFrame, blur_levels, texture_over_noise


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
        moments = np.sum([frame.moments(grid, margin_px) for frame in window], axis=0)
        self.texture_over_noise = texture_over_noise(moments, len(window)).ravel()
        """Of each block, that of all frames together"""
        self._levels = blur_levels(self.texture_over_noise)
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
        moved = expected[:, ::-1]
        last = np.subtract(self._grid.shape, self._grid.block_px)
        seconds = np.clip(self._corners + moved // 2, 0, last)
        costs = self._costs(baseline, seconds - moved, seconds, radius)
        best, exists = least_cost(costs)
        firsts = np.where(exists[:, np.newaxis], seconds - moved - best[:, ::-1], seconds)
        forth = self._costs(baseline, firsts, seconds, 1)
        back = self._costs(-baseline, seconds, firsts, 1)
        shifts = expected + best + parabola_minimum(forth + back[:, ::-1, ::-1])
        return np.where(exists[:, np.newaxis], shifts, np.nan)

    def _costs(
        self,
        baseline: int,
        origins: NDArray[np.int64],
        corners: NDArray[np.int64],
        radius: int,
    ) -> FloatArray:
        """Return the costs of shifts around those from origins to corners, summed over all pairs.

        Blocks lie at `corners` in the frame that comes `baseline` after (before, if negative) the
        one that is searched around `origins`.
        """
        pairs = list(zip(self._window, self._window[abs(baseline) :], strict=False))
        if baseline < 0:
            pairs = [(later, earlier) for earlier, later in pairs]
        costs = np.zeros((len(corners), 2 * radius + 1, 2 * radius + 1))
        for level in np.unique(self._levels):
            mine = np.flatnonzero(self._levels == level)
            part = costs[mine]
            for searched, frame in pairs:
                add_costs(
                    searched.roots(level),
                    frame.roots(level),
                    frame.weights(level),
                    origins[mine],
                    corners[mine],
                    self._grid.block_px,
                    part,
                )
            costs[mine] = part
        return costs
