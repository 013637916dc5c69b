"""Pixels that do not count light, dead or stuck at one reading, or count most without it, hot."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Mask

DEAD_BELOW = 0.05
"""Share of the reference's counts below which a pixel is dead."""
_ENOUGH = 50.0
"""Counts of the reference that show a pixel to be dead."""


def dead_pixels(counts: Floats, reference: Floats) -> Mask:
    """Mark pixels that count almost nothing, by sums over all frames of every recording.

    `counts` and `reference`, of one shape, are those of the pixels and of healthy ones.
    """
    return np.asarray((reference > _ENOUGH) & (counts < DEAD_BELOW * reference))


def constant_pixels(recordings: Sequence[NDArray[np.generic]]) -> Mask:
    """Mark pixels (rows, columns) with one reading in all frames (n, rows, columns) of each."""
    first = recordings[0][0]
    return np.asarray(np.logical_and.reduce([(each == first).all(axis=0) for each in recordings]))


def hot_pixels(low: Floats, dark: Floats, high: Floats, times: float) -> Mask:
    """Mark pixels with surely more dark counts than `times` the median, by 95 % CI (low, high).

    NaN: unknown. Where most pixels have no count, the median is 0, though the array has dark
    counts: instead of it, the mean of pixels that may have no more than it. Noise of the readings
    can make both negative: instead of them, 0.
    """
    ordinary = dark[dark <= np.nanmedian(high)]
    typical = max(0.0, float(np.nanmedian(dark)), float(ordinary.mean()) if ordinary.size else 0.0)
    return np.asarray(low > times * typical)
