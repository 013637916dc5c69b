"""Two-sample tests, pixel by pixel, and how many false alarms all of them make.

Means: Welch's test on the counts of frames; with few counts in all the conditional binomial test
of two Poisson means, which is exact. Variances: the logarithm of their ratio, whose variance is
that of two Poisson-like samples, 2/(n − 1) + 1/(n·m) each. Distributions: `histograms`. False
discovery rates: Benjamini and Hochberg; what differs in no pixel makes an alarm in a share of cases
that is at most the rate.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom, false_discovery_control, norm, t

from megalopta.core.arrays import Floats

_FEW_COUNTS = 200.0
_LEAST_MEAN = 2.0


class PixelTest(NamedTuple):
    """P-values of pixels, and which of them differ at a false discovery rate."""

    p: Floats
    """Of any shape; NaN where nothing is tested."""
    differs: NDArray[np.bool_]


def discoveries(p: Floats, rate: float) -> PixelTest:
    """Mark the p-values, of any shape, that are discoveries at this false discovery rate."""
    tested = np.isfinite(p)
    differs = np.zeros(p.shape, np.bool_)
    if tested.any():
        differs[tested] = false_discovery_control(p[tested].clip(0, 1)) <= rate
    return PixelTest(p, differs)


def mean_test(one: Floats, other: Floats, error: Floats | float = 0.0) -> Floats:
    """P-values (rows, columns) that counts (n, rows, columns) have the same means.

    `error` is the standard error of what the second sample's mean should have been, where that
    comes from a calibration.
    """
    n, k = len(one), len(other)
    parts = [each.var(axis=0, ddof=1) / len(each) for each in (one, other)]
    total = parts[0] + parts[1] + np.square(error)
    difference = one.mean(axis=0) - other.mean(axis=0)
    spread = np.where(total > 0, total, 1)
    freedom = spread**2 / np.maximum(parts[0] ** 2 / (n - 1) + parts[1] ** 2 / (k - 1), 1e-300)
    p = 2 * t.sf(np.abs(difference) / np.sqrt(spread), np.maximum(freedom, 1))
    sums = [np.rint(each.sum(axis=0)).clip(0) for each in (one, other)]
    both = sums[0] + sums[1]
    few = (both < _FEW_COUNTS) & (np.asarray(error) == 0)
    p = np.where(few, _conditional(sums[0], both, n / (n + k)), p)
    same = (total == 0) & ~few
    return np.where(same, np.where(difference == 0, 1.0, 0.0), p)


def _conditional(first: Floats, both: Floats, share: float) -> Floats:
    """Two-sided p-values of a binomial number: twice the smaller tail."""
    below, above = binom.cdf(first, both, share), binom.sf(first - 1, both, share)
    return np.asarray(np.minimum(2 * np.minimum(below, above), 1))


def variance_test(one: Floats, other: Floats) -> Floats:
    """P-values (rows, columns) that counts (n, rows, columns) have the same variances.

    NaN where counts are too few to tell.
    """
    error = np.zeros(one.shape[1:])
    logs, known = [], np.ones(error.shape, np.bool_)
    for each in (one, other):
        mean, variance = each.mean(axis=0), each.var(axis=0, ddof=1)
        known &= (mean > _LEAST_MEAN) & (variance > 0)
        error += 2 / (len(each) - 1) + 1 / (len(each) * np.maximum(mean, _LEAST_MEAN))
        logs.append(np.log(np.where(variance > 0, variance, 1)))
    return np.where(known, 2 * norm.sf(np.abs(logs[0] - logs[1]) / np.sqrt(error)), np.nan)
