"""Single pixels: dead or stuck ones, hot ones, and telegraph noise.

Readings of independent events are uncorrelated from frame to frame. A rate that switches between
two levels correlates them: with a trap that is active half of the time and correlated over τ, the
covariance of frames k apart is (A/2)²·exp(−k·T/τ), A the difference of the two mean readings. τ and
A are too small by a relative 2·τ/T over the number of frames, as the mean is that of the same
frames. Fluctuations that all pixels share have to be taken out before.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Mask, mean_and_variance

DEAD_BELOW = 0.05
"""Share of the reference's counts below which a pixel is dead."""


def dead_pixels(counts: Floats, reference: Floats) -> Mask:
    """Mark pixels that count almost nothing, by sums over all frames of every recording.

    `counts` and `reference`, of one shape, are those of the pixels and of healthy ones.
    """
    return np.asarray((reference > 50.0) & (counts < DEAD_BELOW * reference))


def constant_pixels(recordings: Sequence[NDArray[np.generic]]) -> Mask:
    """Mark pixels (rows, columns) with one reading in all frames (n, rows, columns) of each."""
    first = recordings[0][0]
    return np.asarray(np.logical_and.reduce([(each == first).all(axis=0) for each in recordings]))


def hot_pixels(low: Floats, dark: Floats, high: Floats, times: float = 10.0) -> Mask:
    """Mark pixels with surely more dark counts than `times` the median, by 95 % CI (low, high).

    NaN: unknown. Where most pixels have no count, the median is 0, though the array has dark
    counts: instead of it, the mean of pixels that may have no more than it. Noise of the readings
    can make both negative: instead of them, 0.
    """
    ordinary = dark[dark <= np.nanmedian(high)]
    typical = max(0.0, float(np.nanmedian(dark)), float(ordinary.mean()) if ordinary.size else 0.0)
    return np.asarray(low > times * typical)


LAGS = 6
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
        return np.asarray(self.deviation > 7.0)


def uncorrelated(shape: tuple[int, ...], frames: int) -> Correlation:
    """Return the correlation of readings of which only the sum is known."""
    return Correlation(np.zeros((LAGS, *shape)), np.zeros(shape), frames)


def correlation(readings: NDArray[Any], good: Mask) -> Correlation:
    """Return the correlation of readings (n, rows, columns); 0 for others than good pixels."""
    mean, variance = mean_and_variance(readings)
    counted = good & (variance > 0) & (mean * len(readings) > 30.0)
    scale = np.where(counted, np.sqrt(variance), np.inf)
    sums, before = np.zeros((LAGS, *good.shape)), list[Floats]()
    cubes = np.zeros(good.shape)
    for frame in readings:
        z = np.clip((frame - mean) / scale, -_FARTHEST, _FARTHEST)
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
    mean: Floats, variance: Floats, correlated: Correlation, pixels: Mask
) -> tuple[Floats, Floats, float]:
    """Return the mean readings at both levels (rows, columns), and the correlation time in frames.

    Of all but the marked pixels both are the mean.
    """
    covariance = np.where(pixels, correlated.shares * variance, 0)
    pooled = covariance.sum(axis=(1, 2))
    kept = float(np.clip(pooled[1:].sum() / max(pooled[:-1].sum(), 1e-300), 0.05, 0.98))
    decay = kept ** np.arange(1, LAGS + 1)
    half = np.sqrt(np.maximum(np.tensordot(decay, covariance, 1) / (decay**2).sum(), 0))
    half = np.minimum(half, mean)
    return mean - half, mean + half, -1 / float(np.log(kept))
