"""Total-variation flow (TV-L1), from scikit-image, averaged over blocks.

The flow that minimizes the absolute difference of the frames plus the total variation of the flow
itself, coarse to fine (Zach, Pock and Bischof 2007). The second term carries the flow over places
without texture, so no block lacks a velocity; it also lets neighboring blocks share their photons.
"""

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from megalopta.flow.detectors.base import FloatArray
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.detectors.dense_detector import DenseDetector, PairFlow


class TotalVariation(DenseDetector, frozen=True):
    """Dense flow smoothed by its total variation, averaged over blocks."""

    place: ClassVar[float] = 10

    name: str = "TV-L1"
    """Short name"""

    label: str = "Total variation"
    """Name in words"""

    attachment: Annotated[float, Field(gt=0)] = 15.0
    """Weight of the frames' difference, gray levels from 0 to 1; smaller makes smoother flow"""

    def _dense(self, grid: BlockGrid) -> PairFlow:
        from skimage.registration import optical_flow_tvl1

        def flow(pair: FloatArray) -> FloatArray:
            down, right = optical_flow_tvl1(*pair, attachment=self.attachment, dtype=np.float64)
            return np.stack((right, down), axis=-1)

        return flow
