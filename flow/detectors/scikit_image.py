"""Estimators of scikit-image: total variation (TV-L1) and phase correlation (PC)."""

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from megalopta.flow.detectors.base import FloatArray
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.detectors.gray_detector import DenseDetector, Estimator, GrayDetector, PairFlow

_FADING = 0.5
"""Share of a side over which the frames fade, half of it at either edge (Tukey's window)"""


class TotalVariation(DenseDetector, frozen=True):
    """Dense flow smoothed by its total variation (TV-L1), averaged over blocks.

    The flow that minimizes the absolute difference of the frames plus the total variation of the
    flow itself, coarse to fine (Zach, Pock and Bischof 2007). The second term carries the flow over
    places without texture, so no block lacks a velocity; it also lets neighboring blocks share
    their photons.
    """

    place: ClassVar[float] = 10
    name: str = "TV-L1"
    label: str = "Total variation"
    attachment: Annotated[float, Field(gt=0)] = 15.0
    """Weight of the frames' difference, gray levels from 0 to 1; smaller makes smoother flow"""

    def _dense(self, grid: BlockGrid) -> PairFlow:
        from skimage.registration import optical_flow_tvl1

        def flow(pair: FloatArray) -> FloatArray:
            down, right = optical_flow_tvl1(*pair, attachment=self.attachment, dtype=np.float64)
            return np.stack((right, down), axis=-1)

        return flow


class PhaseCorrelation(GrayDetector, frozen=True):
    """The one shift of the whole frame, given to every block.

    The cross-power spectrum of two frames, whitened so that all spatial frequencies weigh the same,
    is the phase ramp of their shift; its transform peaks there (Kuglin and Hines 1975). The peak is
    refined by a transform on a finer grid around it (Guizar-Sicairos et al. 2008). The frames are
    freed of their mean and fade to zero at the edges, for a transform takes them to be periodic.

    Whitening makes the peak sharp, but gives frequencies that hold nothing but photon noise, or
    leakage of the fading where the texture is smooth, as much weight as any other; without it this
    is plain cross-correlation, which needs fewer photons.

    The method sees all photons of a frame, and no parallax.
    """

    place: ClassVar[float] = 11
    name: str = "PC"
    label: str = "Phase correlation, global"
    whitened: bool = True
    """Whether all spatial frequencies weigh the same"""
    steps_per_px: Annotated[int, Field(ge=1)] = 20
    """Velocities are whole multiples of 1/20 px per frame by default"""

    def _estimator(self, grid: BlockGrid) -> Estimator:
        from scipy.signal.windows import tukey
        from skimage.registration import phase_cross_correlation

        window = np.outer(*(tukey(side, _FADING) for side in grid.shape))
        normalization = "phase" if self.whitened else None

        def estimate(pair: FloatArray) -> FloatArray:
            first, second = (window * (frame - frame.mean()) for frame in pair)
            # What is returned would bring the second frame back onto the first.
            shift, *_ = phase_cross_correlation(
                first, second, upsample_factor=self.steps_per_px, normalization=normalization
            )
            return np.broadcast_to(-shift[::-1], (grid.rows, grid.columns, 2))

        return estimate
