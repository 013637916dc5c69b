"""Pyramidal Lucas–Kanade (LK), from OpenCV: one window around the center of each block.

Bouguet's iterative form: the shift that minimizes the squared difference between a window of frame
t and frame t + 1, found by Newton steps from the coarsest level of a pyramid down to the frames
themselves. Only the finest level decides within a pixel, but the coarser ones see 2, 4, … times as
far, and where a texture has one period of a few pixels only they may start it in the wrong one.
With `pyramid_levels` 1 an estimate uses the photons of its window alone.

A window whose gradients have one direction only, or none, has no velocity (NaN): the smaller
eigenvalue of its structure tensor is below OpenCV's threshold, about a tenth of a squared gray
level per pixel. Nor has a window that was tracked out of the frame.
"""

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from megalopta.flow.detectors.base import FloatArray
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.detectors.gray_detector import Estimator, GrayDetector, eight_bits
from megalopta.flow.detectors.opencv import one_thread

_SMALLEST_WINDOW_PX = 3


class LucasKanade(GrayDetector, frozen=True):
    """Newton search for the shift of a window around each block, coarse to fine."""

    place: ClassVar[float] = 7

    name: str = "LK"
    """Short name"""

    label: str = "Lucas–Kanade, pyramidal"
    """Name in words"""

    window_blocks: Annotated[float, Field(gt=0)] = 1.0
    """Side of the window in sides of a block; 1 sees the very pixels of the block"""

    pyramid_levels: Annotated[int, Field(ge=1)] = 3
    """Largest number of levels, the frames themselves included; 1 is no pyramid"""

    def _estimator(self, grid: BlockGrid) -> Estimator:
        import cv2

        side = max(_SMALLEST_WINDOW_PX, round(self.window_blocks * grid.block_px))
        centers = (grid.centers.reshape(-1, 2) - 0.5).astype(np.float32)

        def estimate(pair: FloatArray) -> FloatArray:
            first, second = eight_bits(pair)
            with one_thread():
                found, status, _ = cv2.calcOpticalFlowPyrLK(
                    first,
                    second,
                    centers,
                    np.empty_like(centers),
                    winSize=(side, side),
                    maxLevel=self.pyramid_levels - 1,
                )
            moved = np.where(status > 0, found - centers, np.nan)
            return moved.reshape(grid.rows, grid.columns, 2).astype(np.float64)

        return estimate
