"""Poisson counts of means from 4 on, each from one normal number.

A normal number z becomes the count n with P(N < n) < Φ(z) ≤ P(N ≤ n), which is exact. Where it
steps from one count to the next, n is ⌊y⌋ of an expansion in 1/√m: Cornish and Fisher, for the
Poisson law as Giles has it, ACM Trans. Math. Softw. 42, 7 (2016), and two orders more,

    y = m + √m·z + (z² + 2)/6 − z(z² + 2)/(72·√m) + (3z⁴ + 7z² − 16)/(810·m)
        − z(207z⁴ + 548z² − 2684)/(155520·m·√m)
        + (228z⁶ + 675z⁴ − 5189z² − 256)/(408240·m²)

What it leaves out is less than `doubt`. Only where y comes so close to a whole number, six draws in
a thousand at a mean of 4, one in a thousand at 8 and in 25,000 at 30, are probabilities summed.
"""

import math

import numpy as np
from numpy.typing import NDArray

from megalopta.core.compiling import compiled

SMALLEST_MEAN = 4.0
_CERTAIN_FROM = 2.0**20
"""Mean from which what is left out is less than the rounding of y"""
_SMALLEST_TERM = 1e-17


@compiled
def fill_quantiles(
    z: NDArray[np.float64], means: NDArray[np.float64], counts: NDArray[np.float64]
) -> None:
    """Turn normal numbers (N,) into Poisson counts (N,) of means (N,).

    Of means below `SMALLEST_MEAN`, which are others' to draw, counts mean nothing.
    """
    doubtful = np.int64(0)
    for k in range(z.size):  # without a branch, so that vector instructions do it
        mean = max(means[k], SMALLEST_MEAN)
        y = place(z[k], mean)
        is_near = abs(y - np.rint(y)) < doubt(z[k], mean)
        is_doubtful = is_near & (means[k] >= SMALLEST_MEAN) & (mean < _CERTAIN_FROM)
        counts[k] = math.nan if is_doubtful else math.floor(y)
        doubtful += np.int64(is_doubtful)
    if doubtful:
        for k in range(z.size):
            if math.isnan(counts[k]):
                counts[k] = exact_quantile(z[k], means[k])


@compiled
def place(z: float, mean: float) -> float:
    """Return y, whose whole part is the count but where it is nearly whole."""
    sigma, square = math.sqrt(mean), z * z
    inverse = 1 / sigma
    # terms of y/√m, which fall by √m each
    third = -z * (square + 2) / 72
    fourth = ((3 * square + 7) * square - 16) / 810
    fifth = -z * ((207 * square + 548) * square - 2684) / 155520
    sixth = (((228 * square + 675) * square - 5189) * square - 256) / 408240
    small = (third + inverse * (fourth + inverse * (fifth + inverse * sixth))) * inverse
    return mean + sigma * z + ((square + 2) / 6 + small)


@compiled
def doubt(z: float, mean: float) -> float:
    """Return how near to a whole number y does not tell the count."""
    square = z * z
    return (0.04 + 0.0015 * square * square * square * abs(z)) / (mean * mean * math.sqrt(mean))


@compiled
def exact_quantile(z: float, mean: float) -> float:
    """Return the count of z, by sums of probabilities of the smaller tail."""
    chance = 0.5 * math.erfc(abs(z) / math.sqrt(2))
    count = max(np.rint(place(z, mean)), 0.0)
    if z < 0:
        count = min(count, np.floor(mean))  # far down the expansion turns up again
        while _at_most(count, mean) < chance:
            count += 1
        while count > 0 and _at_most(count - 1, mean) >= chance:
            count -= 1
    else:
        while _more_than(count, mean) > chance:
            count += 1
        while count > 0 and _more_than(count - 1, mean) <= chance:
            count -= 1
    return float(count)


@compiled
def _probability(count: float, mean: float) -> float:
    return math.exp(count * math.log(mean) - mean - math.lgamma(count + 1))


@compiled
def _at_most(count: float, mean: float) -> float:
    """P(N ≤ count), of a count that is not far above the mean."""
    total, term, n = 1.0, 1.0, count
    while n > 0 and term > _SMALLEST_TERM * total:
        term *= n / mean
        total += term
        n -= 1
    return float(total * _probability(count, mean))


@compiled
def _more_than(count: float, mean: float) -> float:
    """P(N > count), of a count that is not far below the mean."""
    total, term, n = 1.0, 1.0, count + 1
    while term > _SMALLEST_TERM * total:
        n += 1
        term *= mean / n
        total += term
    return float(total * _probability(count + 1, mean))
