"""Sums over a recording of counts or bits, from which a camera is calibrated.

Frames are read one by one: a copy of all as numbers would take eight times the memory of bits.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Mask, mean_and_variance
from megalopta.sensor.calibrate.neighbors import Kernel, neighbor_kernel
from megalopta.sensor.calibrate.steadiness import Drift, check_steadiness, drift
from megalopta.sensor.calibrate.telegraph import LAGS, Correlation, correlation

_FEWEST_FRAMES = 50
_MOST_COUNTS = 2**25
"""Counts of a recording that are looked at for coincidences, 256 MiB of numbers."""


class Summed(NamedTuple):
    """Statistics of one recording, maps (rows, columns)."""

    exposure_s: float
    light_hz: float
    """Photons per second on a pixel, or any unit that all recordings share; 0: dark"""
    is_binary: bool
    frames: int
    total: Floats
    """Sum of all frames"""
    variance: Floats
    largest: Floats
    at_largest: Floats
    """Number of frames at the pixel's own largest reading"""
    steadiness: Drift
    """Drift of the mean over the pixels"""
    correlation: Correlation
    kernel: Kernel | None
    """Crosstalk and afterpulses by coincidences, of counts in the dark that determine them"""

    @property
    def mean(self) -> Floats:
        """Mean reading."""
        return self.total / self.frames

    @property
    def is_constant(self) -> Mask:
        """Pixels with one reading in all frames."""
        return np.asarray(self.at_largest == self.frames)

    def __str__(self) -> str:
        """Short description for readers."""
        light = f"light of {self.light_hz:g}" if self.light_hz else "dark"
        return f"{light}, exposure of {self.exposure_s:g} s"


def summed(
    readings: NDArray[Any], exposure_s: float, light_hz: float, *, is_binary: bool
) -> Summed:
    """Sum up a recording: counts, or bits as 0 and 1, (n, rows, columns).

    Raises ValueError if there are too few frames, or readings drift.
    """
    n = len(readings)
    if readings.ndim != 3 or n < _FEWEST_FRAMES:
        raise ValueError(f"{n} frames; capture {_FEWEST_FRAMES} or more")
    mean, variance = mean_and_variance(readings)
    largest, at_largest = readings.max(axis=0), np.zeros(mean.shape)
    for each in readings:
        at_largest += each == largest
    related = correlation(readings, np.ones(mean.shape, np.bool_))
    varies = (variance > 0) & ~related.is_telegraph
    found = Summed(
        exposure_s,
        light_hz,
        is_binary,
        n,
        mean * n,
        variance,
        largest.astype(np.float64),
        at_largest,
        drift(readings.mean(axis=(1, 2), dtype=np.float64)),
        related,
        None if is_binary or light_hz else _kernel(readings, varies),
    )
    return _steady(found)


def summed_bits(sums: NDArray[Any], bits: int, exposure_s: float, light_hz: float) -> Summed:
    """Sum up a recording whose frames (n, rows, columns) are sums of so many binary frames each.

    Telegraph noise is not looked for. Drift is, in 50 frames or more.

    Raises ValueError if there are too few binary frames, readings exceed their number, or drift.
    """
    n = len(sums) * bits
    if n < _FEWEST_FRAMES:
        raise ValueError(f"{n} binary frames; capture {_FEWEST_FRAMES} or more")
    if sums.max() > bits:
        raise ValueError(f"a frame has {sums.max()} counts, more than sums: {bits} binary frames")
    total = sums.sum(axis=0, dtype=np.float64)
    share = total / n
    series = sums.mean(axis=(1, 2), dtype=np.float64) / bits
    found = Summed(
        exposure_s,
        light_hz,
        is_binary=True,
        frames=n,
        total=total,
        variance=share * (1 - share) * n / (n - 1),
        largest=(total > 0).astype(np.float64),
        at_largest=np.where(total > 0, total, n),
        steadiness=drift(series) if len(sums) >= _FEWEST_FRAMES else Drift(0.0, 0.0),
        correlation=Correlation(np.zeros((LAGS, *total.shape)), np.zeros(total.shape), n),
        kernel=None,
    )
    return _steady(found)


def _kernel(readings: NDArray[Any], good: Mask) -> Kernel | None:
    """Crosstalk and afterpulses of good pixels; None if too few have neighbors."""
    frames = max(_MOST_COUNTS // good.size, _FEWEST_FRAMES)
    try:
        return neighbor_kernel(readings[:frames], good)
    except ValueError:
        return None


def _steady(found: Summed) -> Summed:
    check_steadiness(found, found.steadiness, float(np.sqrt(found.variance.mean())))
    return found
