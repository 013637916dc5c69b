"""Single pixels: dead or stuck ones, hot ones, and telegraph noise.

Readings of independent events are uncorrelated from frame to frame. A rate that switches between
two levels correlates them: with a trap that is active half of the time and correlated over τ, the
covariance of frames k apart is (A/2)²·exp(−k·T/τ), A the difference of the two mean readings. τ and
A are too small by a relative 2·τ/T over the number of frames, as the mean is that of the same
frames. Fluctuations that all pixels share have to be taken out before.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Mask
from megalopta.core.quantities import with_error
from megalopta.sensor.calibrate.statistics import LAGS, Statistics

_95 = 1.959964


@dataclass(frozen=True, eq=False)
class Estimate:
    """One quantity of every pixel with its 95 % CI, each (rows, columns); NaN: unknown."""

    value: Floats
    low: Floats
    high: Floats

    @classmethod
    def normal(cls, value: Floats, error: Floats, shape: tuple[int, int]) -> "Estimate":
        """Return a value with the interval of this standard error."""
        error = np.where(error > 0, error, np.nan)
        value, spread = np.where(np.isfinite(error), value, np.nan), _95 * error
        return cls(*(end.reshape(shape) for end in (value, value - spread, value + spread)))

    @property
    def median(self) -> float:
        """Median over the known pixels; NaN if none is known."""
        return float(np.nanmedian(self.value)) if np.isfinite(self.value).any() else np.nan

    def where(self, known: Mask, value: float = np.nan) -> "Estimate":
        """Return the estimate with another value, and interval, where it is not known."""
        ends = self.value, self.low, self.high
        return Estimate(*(np.where(known, end, value) for end in ends))

    def scaled(self, factor: Floats | float) -> "Estimate":
        """Return the estimate in another unit."""
        return Estimate(self.value * factor, self.low * factor, self.high * factor)


def dead_pixels(counts: Floats, reference: Floats) -> Mask:
    """Mark pixels that count less than 5 % of a reference, by sums over all frames."""
    return np.asarray((reference > 50.0) & (counts < 0.05 * reference))


def constant_pixels(recordings: Sequence[NDArray[np.generic]]) -> Mask:
    """Mark pixels (rows, columns) with one reading in all frames (n, rows, columns) of each."""
    first = recordings[0][0]
    return np.asarray(
        np.logical_and.reduce([(frames == first).all(axis=0) for frames in recordings])
    )


def hot_pixels(low: Floats, dark: Floats, high: Floats, times: float = 10.0) -> Mask:
    """Mark pixels with surely more dark counts than `times` the median, by 95 % CI (low, high).

    NaN: unknown. Where most pixels have no count, the median is 0, though the array has dark
    counts: instead of it, the mean of pixels that may have as few. Noise of the readings
    can make both negative: instead of them, 0.
    """
    ordinary = dark[dark <= np.nanmedian(high)]
    typical = max(0.0, float(np.nanmedian(dark)), float(ordinary.mean()) if ordinary.size else 0.0)
    return np.asarray(low > times * typical)


class Quantity(NamedTuple):
    """One estimate of every pixel, as a page or a sentence shows it."""

    name: str
    unit: str
    estimate: Estimate
    scale: float = 1.0
    """Factor to that unit"""

    @property
    def text(self) -> str:
        """Median over pixels, and of the half widths of their 95 % CI: "315 ± 9 Hz"."""
        widths = self.scale * (self.estimate.high - self.estimate.low) / 2
        half_width = float(np.nanmedian(widths)) if np.isfinite(widths).any() else np.nan
        return with_error(self.scale * self.estimate.median, half_width, self.unit)

    def __str__(self) -> str:
        """Name, text, and the mean where it is clearly another."""
        values, mean = self.scale * self.estimate.value, ""
        if np.isfinite(values).any() and abs(np.nanmean(values) / np.nanmedian(values) - 1) > 0.03:
            mean = f", mean {with_error(float(np.nanmean(values)), 0, self.unit)}"
        return f"{self.name} {self.text}{mean}"


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


def correlation(recording: Statistics, good: Mask) -> Correlation:
    """Return the correlation of readings; 0 for others than good pixels."""
    mean, variance = recording.mean, recording.variance
    counted = good & (variance > 0) & (mean * recording.frames > 30.0)
    scale = np.where(counted, np.sqrt(variance), np.inf)
    return Correlation(recording.later / scale**2, recording.third / scale**3, recording.frames)


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
