"""Pooling along x with a triangular kernel, as before the detectors of the thesis's bench (§2.4.8).

There five pixels of weights 1, 2, 3, 2, 1 turn a row of 16 pixels into 12: less shot noise, and
less of what tells neighboring pixels apart, for a blurred image. Only pixels with all of their
neighbors are kept, so nothing is invented at the ends.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray


def triangular_pool(frames: NDArray[Any], taps: int = 5) -> NDArray[np.float64]:
    """Return frames (..., W − taps + 1), each pixel a weighted mean of `taps` pixels along x.

    Parameters
    ----------
    frames : (..., W)
        Counts or intensities.
    taps : int
        Length of the kernel, odd, so that pixels stay in place: the new column j is centered on
        the old column j + (taps − 1)/2.

    Raises
    ------
    ValueError
        When the kernel's length is even or not positive, or exceeds the width.
    """
    width = frames.shape[-1]
    if taps < 1 or taps % 2 == 0 or taps > width:
        raise ValueError(
            f"taps {taps} for rows of {width} px: use an odd number from 1 to the width"
        )
    weights = triangular_weights(taps)
    kept = width - taps + 1
    pooled = np.zeros((*frames.shape[:-1], kept))
    for first, weight in enumerate(weights):
        pooled += weight * frames[..., first : first + kept]
    return pooled


def triangular_weights(taps: int) -> NDArray[np.float64]:
    """Return the kernel (taps,), which sums to 1."""
    half = (taps + 1) // 2
    weights = half - np.abs(np.arange(taps) - half + 1.0)
    return np.asarray(weights / weights.sum())
