"""Pixels that cannot be used, and what stands in their place."""

import numpy as np
from scipy.ndimage import convolve

from megalopta.core.arrays import Floats, Mask

_WEIGHTS = np.array([[0.5, 1.0, 0.5], [1.0, 0.0, 1.0], [0.5, 1.0, 0.5]])


def hot_pixels(dark: Floats, times: float) -> Mask:
    """Return which pixels have more dark counts than so many times the median, (rows, columns).

    Raises
    ------
    ValueError
        When that would be half of them or more.
    """
    hot = dark > times * max(float(np.median(dark)), 0.0)
    if dark.size and 2 * int(hot.sum()) >= dark.size:
        raise ValueError(
            f"hot_times: {times:g} times the median of the dark counts marks {hot.mean():.0%} of "
            "the pixels; give more"
        )
    return np.asarray(hot)


def filled_in(values: Floats, variance: Floats, bad: Mask) -> tuple[Floats, Floats]:
    """Return frames in which bad pixels are the mean of their good neighbors, and their variance.

    Neighbors across an edge weigh twice as much as those across a corner. Where all eight are bad,
    those filled in before stand in for them. A frame without any good pixel stays as it is.

    Parameters
    ----------
    values, variance : (T, rows, columns)
    bad : (rows, columns) or (T, rows, columns)
    """
    values, variance = values.copy(), variance.copy()
    known = np.broadcast_to(~bad, values.shape).copy()
    known |= ~known.any(axis=(1, 2), keepdims=True)
    weights = _WEIGHTS[np.newaxis]
    while not known.all():
        total = convolve(known.astype(np.float64), weights, mode="constant")
        fill = ~known & (total > 0)
        sums = convolve(np.where(known, values, 0), weights, mode="constant")
        spread = convolve(np.where(known, variance, 0), weights**2, mode="constant")
        values[fill] = sums[fill] / total[fill]
        variance[fill] = spread[fill] / total[fill] ** 2
        known |= fill
    return values, variance
