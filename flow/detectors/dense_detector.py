"""What estimators of the flow at every pixel have in common: a block's velocity is its mean.

`dense` gives the flow itself. A flow that is undefined at a pixel leaves its block undefined.
"""

from abc import abstractmethod
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from megalopta.core.errors import UserError
from megalopta.flow.detectors.base import FloatArray, Frames, check_finite
from megalopta.flow.detectors.blocks import BlockGrid, block_sums
from megalopta.flow.detectors.gray_detector import Estimator, GrayDetector, gray_levels

PairFlow: TypeAlias = Callable[[FloatArray], NDArray[Any]]
"""Two frames (2, H, W), from 0 to 1, to their flow (H, W, 2)."""


class MethodError(UserError, ValueError):
    """A method of somebody else fails, or gives what is no flow; the message names it."""


class DenseDetector(GrayDetector, frozen=True):
    """Dense flow of pairs of pictures, averaged over blocks."""

    def dense(self, first: Frames, second: Frames) -> FloatArray:
        """Return the flow from one frame (H, W) to the next, (H, W, 2), NaN without contrast.

        Raises
        ------
        ValueError
            When the frames differ in shape, are too small or not finite.
        """
        shape = (first.shape[0], first.shape[1])
        check_finite(first, second)
        flow = self._checked(self.grid(shape))
        pair = gray_levels(self._prepared(np.stack((first, second))))
        return np.full((*shape, 2), np.nan) if pair is None else flow(pair)

    def _estimator(self, grid: BlockGrid) -> Estimator:
        flow = self._checked(grid)
        return lambda pair: mean_over_blocks(flow(pair), grid)

    def _checked(self, grid: BlockGrid) -> Estimator:
        estimate, expected = self._dense(grid), (*grid.shape, 2)

        def checked(pair: FloatArray) -> FloatArray:
            flow = np.asarray(estimate(pair), np.float64)
            if flow.shape != expected:
                raise MethodError(
                    f"{self.name}: a flow of shape {flow.shape}; give {expected}, x before y"
                )
            return flow

        return checked

    @abstractmethod
    def _dense(self, grid: BlockGrid) -> PairFlow: ...


def mean_over_blocks(flow: FloatArray, grid: BlockGrid) -> FloatArray:
    """Return the mean of a dense flow (H, W, 2) over each block, (rows, columns, 2)."""
    sums = [block_sums(flow[..., axis], grid) for axis in range(2)]
    return np.stack(sums, axis=-1) / grid.block_px**2
