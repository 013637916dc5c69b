"""Global phase correlation (PC), from scikit-image: one velocity for the whole frame.

The cross-power spectrum of two frames, whitened so that all spatial frequencies weigh the same, is
the phase ramp of their shift; its transform peaks there (Kuglin and Hines 1975). The peak is
refined by a transform on a finer grid around it (Guizar-Sicairos et al. 2008). The frames are
freed of their mean and fade to zero at the edges, for a transform takes them to be periodic.

Whitening makes the peak sharp, but gives frequencies that hold nothing but photon noise, or leakage
of the fading where the texture is smooth, as much weight as any other; without it this is plain
cross-correlation, which needs fewer photons.

Every block gets the same velocity: the method sees all photons of a frame, and no parallax.
"""

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from megalopta.flow.detectors.base import FloatArray
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.detectors.gray_detector import Estimator, GrayDetector

_FADING = 0.5
"""Share of a side over which the frames fade, half of it at either edge (Tukey's window)"""


class PhaseCorrelation(GrayDetector, frozen=True):
    """The one shift of the whole frame, given to every block."""

    place: ClassVar[float] = 11

    name: str = "PC"
    """Short name"""

    label: str = "Phase correlation, global"
    """Name in words"""

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
