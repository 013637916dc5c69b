"""The best shift of each block from a frame to the next, from all such pairs of a few frames."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from megalopta.flow.detectors.base import FloatArray
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.detectors.shift_cost import add_costs, least_cost, parabola_minimum
from megalopta.flow.detectors.shot_noise_blur import SmoothedFrame, suited_levels


def neighbor_shifts(window: Sequence[SmoothedFrame], grid: BlockGrid, radius: int) -> FloatArray:
    """Return how far the content of each block moves from frame to frame, (blocks, 2), x and y, px.

    NaN where all shifts are as likely.

    Parameters
    ----------
    window : sequence of frames
        Oldest first, two or more.
    grid
        Blocks of all frames.
    radius : int
        Largest shift searched in x and in y (px); so far around a block its texture and noise are
        judged, too.
    """
    levels, seconds = suited_levels(window, grid, radius), grid.corners
    pairs = list(pairwise(window))
    costs = _costs(pairs, levels, seconds, seconds, grid.block_px, radius)
    best, exists = least_cost(costs)
    firsts = np.where(exists[:, np.newaxis], seconds - best[:, ::-1], seconds)
    forth = _costs(pairs, levels, firsts, seconds, grid.block_px, 1)
    swapped = [(later, earlier) for earlier, later in pairs]
    back = _costs(swapped, levels, seconds, firsts, grid.block_px, 1)
    shifts = best + parabola_minimum(forth + back[:, ::-1, ::-1])
    return np.where(exists[:, np.newaxis], shifts, np.nan)


def _costs(
    pairs: Sequence[tuple[SmoothedFrame, SmoothedFrame]],
    levels: NDArray[np.intp],
    origins: NDArray[np.int64],
    corners: NDArray[np.int64],
    block_px: int,
    radius: int,
) -> FloatArray:
    """Return the costs of shifts around those from origins to corners, summed over all pairs.

    Blocks lie at `corners` in the second frame of a pair; the first is searched around `origins`.
    """
    costs = np.zeros((len(corners), 2 * radius + 1, 2 * radius + 1))
    for level in np.unique(levels):
        mine = np.flatnonzero(levels == level)
        part = costs[mine]
        for searched, frame in pairs:
            add_costs(
                searched.roots(level),
                frame.roots(level),
                frame.weights(level),
                origins[mine],
                corners[mine],
                block_px,
                part,
            )
        costs[mine] = part
    return costs
