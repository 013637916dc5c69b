"""Telegraph noise of single pixels, from readings of consecutive frames.

Readings of independent events are uncorrelated from frame to frame. A rate that switches between
two levels correlates them: with a trap that is active half of the time and correlated over τ, the
covariance of frames k apart is (A/2)²·exp(−k·T/τ), A the difference of the two mean readings. The
decay of all marked pixels together gives τ, the size of each pixel's covariances its A. Both are
too small by a relative 2·τ/T over the number of frames, as the mean is that of the same frames.

Fluctuations that all pixels share correlate readings, too: they have to be taken out before.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Mask, mean_and_variance

LAGS = 6
_Z = 7.0
_FEWEST_COUNTS = 30.0
_FARTHEST = 5.0
"""Deviation, in standard deviations, to which single readings are limited."""


class Correlation(NamedTuple):
    """Correlation of the readings of pixels over frames."""

    shares: Floats
    """Covariance with the frames 1 to 6 later over the variance, (6, rows, columns)"""
    skewness: Floats
    """Skewness of the readings, (rows, columns)"""
    frames: int

    @property
    def deviation(self) -> Floats:
        """Deviation from no correlation (rows, columns), as that of a normal variable."""
        many, cubed = np.sqrt(self.frames), self.skewness**2
        next_one = _normal(self.shares[0] * many, cubed / many)
        # 3 · (LAGS − 1): from products of three frames
        several = self.shares.sum(axis=0) * many / np.sqrt(LAGS)
        several = _normal(several, (cubed + 3 * (LAGS - 1)) / (np.sqrt(LAGS) * many))
        return np.asarray(np.maximum(next_one, several))

    @property
    def is_telegraph(self) -> Mask:
        """Pixels (rows, columns) whose readings are correlated, by 1e-12 not by chance."""
        return np.asarray(self.deviation > _Z)


def correlation(readings: NDArray[Any], good: Mask) -> Correlation:
    """Return the correlation of readings (n, rows, columns); 0 for others than good pixels."""
    mean, variance = mean_and_variance(readings)
    counted = good & (variance > 0) & (mean * len(readings) > _FEWEST_COUNTS)
    scale = np.where(counted, np.sqrt(variance), np.inf)
    sums, before = np.zeros((LAGS, *good.shape)), list[Floats]()
    cubes = np.zeros(good.shape)
    for each in readings:
        z = np.clip((each - mean) / scale, -_FARTHEST, _FARTHEST)
        cubes += z**3
        for lag, earlier in enumerate(before):
            sums[lag] += z * earlier
        before = [z, *before[: LAGS - 1]]
    return Correlation(sums / len(readings), cubes / len(readings), len(readings))


def _normal(deviation: Floats, skewness: Floats) -> Floats:
    """Return the normal deviation that is as unlikely as one of a sum with some skewness.

    Products of few events have a longer tail than the normal distribution, nearly that of a gamma
    distribution, whose cube root is nearly normal (Wilson and Hilferty 1931).
    """
    half = np.maximum(skewness, 1e-6) / 2
    return np.asarray(3 / half * (np.cbrt(1 + half * deviation) - 1) + half / 3)


def switching(
    mean: Floats, variance: Floats, found: Correlation, pixels: Mask
) -> tuple[Floats, Floats, float]:
    """Return the mean readings at both levels (rows, columns), and the correlation time in frames.

    Of all but the marked pixels both are the mean.
    """
    covariance = np.where(pixels, found.shares * variance, 0)
    pooled = covariance.sum(axis=(1, 2))
    kept = float(np.clip(pooled[1:].sum() / max(pooled[:-1].sum(), 1e-300), 0.05, 0.98))
    decay = kept ** np.arange(1, LAGS + 1)
    half = np.sqrt(np.maximum(np.tensordot(decay, covariance, 1) / (decay**2).sum(), 0))
    half = np.minimum(half, mean)
    return mean - half, mean + half, -1 / float(np.log(kept))
