"""Poisson counts, drawn faster than NumPy does, for a mean that differs from draw to draw.

A Poisson count is the sum of independent ones whose means add up. Of a mean below 64 the whole part
has a table: inversion of the distribution function from a guide into it, Chen and Asau, AIIE
Transactions 6, 163 (1974). The rest, below one, is the number of arrivals of a process of rate one
that runs on from draw to draw, so a mean near zero costs a subtraction. From 64 on: Hörmann's
transformed rejection with squeeze, Insurance: Mathematics and Economics 12, 39 (1993), whose
logarithms are needed for one draw in ten only. Mean and variance are the mean given.
"""

from functools import cache
from math import floor, lgamma, log, sqrt

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.special import pdtr

_TABLES = 64
_LARGEST_COUNT = 180
"""Of a table; larger ones are less likely than the rounding of a uniform number."""
_GUIDES = 256


def draw_poisson(rng: np.random.Generator, means: NDArray[np.float64]) -> NDArray[np.int64]:
    """Draw one count for each of the means, (N,)."""
    return np.asarray(_draw(rng, means, *_tables()))


@cache
def _tables() -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """Return P(X ≤ count) for each whole mean, and where to start a search in it."""
    counts, means = np.arange(_LARGEST_COUNT + 1), np.arange(_TABLES)[:, np.newaxis]
    cumulative = np.asarray(pdtr(counts, means), np.float64)
    cumulative[:, -1] = np.inf
    starts = np.arange(_GUIDES) / _GUIDES
    guides = [np.searchsorted(row, starts, side="right") for row in cumulative]
    return cumulative, np.array(guides, np.uint8)


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _draw(
    rng: np.random.Generator,
    means: NDArray[np.float64],
    cumulative: NDArray[np.float64],
    guides: NDArray[np.uint8],
) -> NDArray[np.int64]:
    counts = np.empty(means.size, np.int64)
    to_next_arrival = rng.standard_exponential()
    for index in range(means.size):
        mean = means[index]
        if mean >= _TABLES:
            counts[index] = _reject(rng, mean)
            continue
        whole, count = int(mean), 0
        if whole > 0:
            uniform = rng.random()
            count = int(guides[whole, int(uniform * _GUIDES)])
            while cumulative[whole, count] <= uniform:
                count += 1
        to_next_arrival -= mean - whole
        while to_next_arrival < 0:
            to_next_arrival += rng.standard_exponential()
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
