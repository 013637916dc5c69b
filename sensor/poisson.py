"""Poisson counts, drawn a little faster than NumPy does, for a mean that differs from draw to draw.

Means below 10: inversion, adding up the probabilities of 0, 1, 2 … until they exceed a uniform
number. Others: Hörmann's transformed rejection with squeeze, Insurance: Mathematics and Economics
12, 39 (1993), whose logarithms are needed for one draw in ten only. Mean and variance are the mean
given.
"""

from math import exp, floor, lgamma, log, sqrt

import numpy as np
from numba import njit
from numpy.typing import NDArray

_LARGEST_INVERTED = 10.0
_RECIPROCALS = 1 / np.arange(1, 129)


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def draw_poisson(rng: np.random.Generator, means: NDArray[np.float64]) -> NDArray[np.int64]:
    """Draw one count for each of the means, (N,)."""
    counts = np.empty(means.size, np.int64)
    for index in range(means.size):
        mean = means[index]
        if mean >= _LARGEST_INVERTED:
            counts[index] = _reject(rng, mean)
            continue
        count, probability, left = 0, exp(-mean), rng.random()
        # beyond 128 counts there is less than the rounding of the uniform number
        while left >= probability and count < 128:
            left -= probability
            probability *= mean * _RECIPROCALS[count]
            count += 1
        counts[index] = count
    return counts


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _reject(rng: np.random.Generator, mean: float) -> int:
    b = 0.931 + 2.53 * sqrt(mean)
    a = -0.059 + 0.02483 * b
    squeeze = 0.9277 - 3.6224 / (b - 2)
    while True:
        u, v = rng.random() - 0.5, rng.random()
        rest = 0.5 - abs(u)
        if rest < 0.013 and v > rest:
            continue
        count = floor((2 * a / rest + b) * u + mean + 0.43)
        if rest >= 0.07 and v <= squeeze:
            return int(count)
        if count >= 0:
            scale = (1.1239 + 1.1328 / (b - 3.4)) / (a / rest**2 + b)
            if log(v * scale) <= count * log(mean) - mean - lgamma(count + 1.0):
                return int(count)
