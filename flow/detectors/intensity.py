"""Intensity measurement (IM): the pixel value, a baseline for the motion detectors.

Thesis §4.4. The relative error of a Poisson count of mean λ is the mean absolute deviation E|X −
λ|/λ = 2 exp(−λ) λ^⌊λ⌋ / ⌊λ⌋!, which is 25 % at λ = 10.133.
"""

from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gammaln, xlogy

from megalopta.core.arrays import Floats
from megalopta.flow.detectors.base import Detector, Responder


class IntensityMeasurement(Detector, frozen=True):
    """Scaled pixel values, including dark counts."""

    place: ClassVar[float] = 6
    gives: ClassVar[Literal["response", "velocity"]] = "response"
    ignores_offset: ClassVar[bool] = False

    name: str = "IM"
    label: str = "Intensity measurement"

    @property
    def memory_frames(self) -> int:
        """0: frames are independent."""
        return 0

    def start(self, shape: tuple[int, int]) -> Responder:
        """Return the scaling of frames; see `Detector.start`."""
        if min(shape) < 3:
            raise ValueError(f"frames of {shape[0]} × {shape[1]} px: {self.name} needs 3 × 3 px")
        return lambda frames, scale: np.asarray(frames * np.float64(scale))

    def expected_deviation(self, means: Floats, scale: float) -> Floats:
        """Return the mean absolute deviation of Poisson counts; see `Detector`."""
        return mean_absolute_deviation(means) * np.float64(scale)

    def scored(self, responses: Floats) -> Floats:
        """Return pixels 2 to N − 1 of each side, as in Eq. 4.5."""
        return responses[:, 1:-1, 1:-1, np.newaxis]


def mean_absolute_deviation(means: ArrayLike) -> Floats:
    """Return E|X − λ| of Poisson counts of means λ: 2 exp(−λ) λ^(⌊λ⌋ + 1) / ⌊λ⌋!."""
    mean = np.asarray(means, np.float64)
    floor = np.floor(mean)
    exact = 2 * np.exp(xlogy(floor + 1, mean) - mean - gammaln(floor + 1))
    # where the terms of the exponent would cancel: normal approximation, within 1e-6
    return np.where(mean > 1e6, np.sqrt(2 * mean / np.pi), exact)
