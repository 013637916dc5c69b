"""Drift of a recording: its second half against its first.

A drift is refused where it is more than chance and more than 0.5 % of a pixel's noise, in codes of
an ADC, counts and bits alike. Below that, its covariance is below 1e-5 of a pixel's variance, too
small to look like crosstalk, and means of up to 40,000 frames change by less than their standard
errors.
"""

from typing import NamedTuple

import numpy as np

from megalopta.core.arrays import Floats

_LARGEST_Z, _SMALLEST = 6.0, 0.005


class Drift(NamedTuple):
    """Mean of the second half of a series less that of the first, and its standard error."""

    change: float
    error: float

    @property
    def z(self) -> float:
        """Change in standard errors."""
        return self.change / max(self.error, 1e-300) if self.change else 0.0


def drift(series: Floats) -> Drift:
    """Return the drift of one value per frame, (n,), of independent frames."""
    half = len(series) // 2
    first, second = series[:half], series[half:]
    error = np.sqrt(first.var(ddof=1) / first.size + second.var(ddof=1) / second.size)
    return Drift(float(second.mean() - first.mean()), float(error))


def check_steadiness(recording: object, found: Drift, pixel_sigma: float) -> None:
    """Refuse a recording that drifts; ValueError names it.

    `pixel_sigma` is the standard deviation of a pixel, RMS over the pixels.
    """
    if abs(found.z) > _LARGEST_Z and abs(found.change) > _SMALLEST * pixel_sigma:
        raise ValueError(
            f"{recording}: drifts; the second half differs from the first by "
            f"{found.change / max(pixel_sigma, 1e-300):+.2g} times the noise of a pixel, "
            f"{abs(found.z):.0f} standard errors; let light and temperature settle and capture "
            "again"
        )
