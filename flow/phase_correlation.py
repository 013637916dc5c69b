"""Global phase correlation (PC), from scikit-image: one velocity for the whole frame.

The cross-power spectrum of two frames, whitened so that all spatial frequencies weigh the same, is
the phase ramp of their shift; its transform peaks there (Kuglin and Hines 1975). The peak is
refined by a transform on a finer grid around it (Guizar-Sicairos et al. 2008). The frames are
freed of their mean and fade to zero at the edges (Hann), for a transform takes them to be periodic.

Every block gets the same velocity: the method sees all photons of a frame, and no parallax.
"""

from typing import Annotated

import numpy as np
from pydantic import Field

from megalopta.flow.blocks import BlockGrid
from megalopta.flow.detector import FloatArray
from megalopta.flow.gray_detector import Estimator, GrayDetector


class PhaseCorrelation(GrayDetector, frozen=True):
    """The one shift of the whole frame, given to every block."""

    name: str = "PC"
    """Short name"""

    label: str = "Phase correlation, global"
    """Name in words"""

    steps_per_px: Annotated[int, Field(ge=1)] = 20
    """Velocities are whole multiples of 1/20 px per frame by default"""

    def _estimator(self, grid: BlockGrid) -> Estimator:
        from skimage.registration import phase_cross_correlation

        window = np.outer(*(np.hanning(side + 2)[1:-1] for side in grid.shape))

        def estimate(pair: FloatArray) -> FloatArray:
            first, second = (window * (frame - frame.mean()) for frame in pair)
            # What is returned would bring the second frame back onto the first.
            shift, *_ = phase_cross_correlation(first, second, upsample_factor=self.steps_per_px)
            return np.broadcast_to(-shift[::-1], (grid.rows, grid.columns, 2))

        return estimate
