"""What the estimators of OpenCV and scikit-image have in common: gray levels in, blocks out.

They were made for pictures and expect gray levels of a fixed range. Photon counts are brought to it
pair by pair, by one linear map of both frames: the darkest pixel of the two becomes 0, the
brightest 1. Nothing is clipped, and neither gain nor offset of the counts changes a velocity.
Estimators that take 8 bits only round to 256 levels, which loses nothing as long as the counts of
a pair span less than 256, and is below the photon noise wherever a pixel holds more than
(span/255)²/12 photons.

A pair without any contrast has no velocity (NaN); an estimator says more where it can know more.
Velocities belong to the blocks of the first frame of a pair.
"""

from abc import abstractmethod
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.flow.detectors.base import FloatArray, Frames, Responder, in_pairs
from megalopta.flow.detectors.block_detector import BlockDetector
from megalopta.flow.detectors.blocks import BlockGrid, block_sums

Estimator = Callable[[FloatArray], FloatArray]
"""Two frames (2, H, W), from 0 to 1, to the velocities of the blocks (rows, columns, 2)."""


class GrayDetector(BlockDetector, frozen=True):
    """A block detector that sees pairs of pictures with gray levels from 0 to 1."""

    def start(self, shape: tuple[int, int]) -> Responder:
        """Return the estimator for frames (H, W); see `Detector.start`."""
        grid = self.grid(shape)
        return in_pairs(partial(_velocities, grid, self._estimator(grid)))

    def scored(self, responses: FloatArray) -> FloatArray:
        """Return the velocities of the blocks inside."""
        return responses[:, 1:-1, 1:-1, :]

    @abstractmethod
    def _estimator(self, grid: BlockGrid) -> Estimator: ...


def eight_bits(pair: FloatArray) -> NDArray[np.uint8]:
    """Return gray levels from 0 to 1 as 0 to 255, rounded."""
    return np.rint(255 * pair).astype(np.uint8)


def mean_over_blocks(flow: NDArray[Any], grid: BlockGrid) -> FloatArray:
    """Return the mean of a dense flow (H, W, 2) over each block, (rows, columns, 2)."""
    exact = flow.astype(np.float64)
    sums = [block_sums(exact[..., axis], grid) for axis in range(2)]
    return np.stack(sums, axis=-1) / grid.block_px**2


def _velocities(grid: BlockGrid, estimate: Estimator, frames: Frames) -> FloatArray:
    velocities = np.full((len(frames) - 1, grid.rows, grid.columns, 2), np.nan)
    for index in range(len(frames) - 1):
        pair = frames[index : index + 2].astype(np.float64)
        darkest, brightest = pair.min(), pair.max()
        if brightest > darkest:
            velocities[index] = estimate((pair - darkest) / (brightest - darkest))
    return velocities
