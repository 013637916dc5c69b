"""Farnebäck's dense flow by polynomial expansion (FB), from OpenCV, averaged over blocks.

Around each pixel both frames are approximated by quadratic polynomials; how their linear terms
differ gives the shift, by least squares over a window (Farnebäck 2003). It takes the gray levels
unrounded. Where there is no texture the flow tends to 0, which it cannot tell from standstill.
Right and lower neighbors beyond the frame count as unmatched texture: two equal frames give a flow
of exactly 0 only away from the border.
"""

from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from megalopta.flow.detectors.base import FloatArray
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.detectors.dense_detector import DenseDetector, PairFlow
from megalopta.flow.detectors.opencv import one_thread

_NEIGHBORHOOD_PX = 5
_NEIGHBORHOOD_SIGMA_PX = 1.1
"""OpenCV's recommendation for this size"""

_ITERATIONS = 3
_GRAY_LEVELS = 255
"""The estimator's regularization is an absolute number, made for 8-bit pictures."""


class Farneback(DenseDetector, frozen=True):
    """Dense flow from local quadratic polynomials, averaged over blocks."""

    place: ClassVar[float] = 8

    name: str = "FB"
    """Short name"""

    label: str = "Farnebäck"
    """Name in words"""

    window_blocks: Annotated[float, Field(gt=0)] = 1.0
    """Side of the averaging window in sides of a block"""

    pyramid_levels: Annotated[int, Field(ge=1)] = 3
    """Largest number of levels, the frames themselves included; 1 is no pyramid"""

    def _dense(self, grid: BlockGrid) -> PairFlow:
        import cv2

        window = max(1, round(self.window_blocks * grid.block_px))

        def flow(pair: FloatArray) -> NDArray[Any]:
            first, second = (_GRAY_LEVELS * pair).astype(np.float32)
            with one_thread():
                return cv2.calcOpticalFlowFarneback(
                    first,
                    second,
                    np.empty((*grid.shape, 2), np.float32),
                    pyr_scale=0.5,
                    levels=self.pyramid_levels,
                    winsize=window,
                    iterations=_ITERATIONS,
                    poly_n=_NEIGHBORHOOD_PX,
                    poly_sigma=_NEIGHBORHOOD_SIGMA_PX,
                    flags=0,
                )

        return flow
