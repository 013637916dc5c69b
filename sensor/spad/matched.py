"""Distributions of numbers of events with a given mean and variance.

They are of Panjer's family, P(n)/P(n−1) = α + β/n with 1 − α = mean/variance: negative binomial if
the variance exceeds the mean. Otherwise they are mixtures of two binomials, or of a binomial and
the two integers next to the mean, with exactly this mean and variance.
"""

import numpy as np

from megalopta.core.arrays import Floats, Ints
from megalopta.core.compiling import compiled

_SIGMAS, _EVENTS, _CLUMPS = 8, 12, 20
_WIDE, _FAR = 25.0, 10.0
"""Variance from which draws are rounded normal numbers, if the mean is so many deviations from 0"""


def reach_of_events(mean: Floats, variance: Floats) -> Floats:
    """Smallest and largest likely number of events, (2, ...); probability of others 1e-12."""
    sigma = np.sqrt(variance)
    clump = np.maximum(np.divide(variance, mean, out=np.ones_like(mean), where=mean > 0), 1)
    least = np.maximum(np.floor(mean - _SIGMAS * sigma), 0)
    return np.array([least, np.ceil(mean + _SIGMAS * sigma + _EVENTS + _CLUMPS * (clump - 1))])


def draw_matched(rng: np.random.Generator, mean: Floats, variance: Floats) -> Ints:
    """Draw numbers of events (P,); where the variance is large, normal and rounded."""
    normals, uniforms = rng.standard_normal(mean.size), rng.random(mean.size)
    # rounding to integers adds 1/12 to the variance
    counts = np.rint(mean + np.sqrt(np.maximum(variance - 1 / 12, 0)) * normals)
    narrow = np.flatnonzero((variance < _WIDE) | (mean**2 < _FAR**2 * variance))
    least, most = reach_of_events(mean[narrow], variance[narrow])
    counts[narrow] = _inverted(uniforms[narrow], mean[narrow], variance[narrow], least, most)
    return counts.astype(np.int64)


@compiled
def _inverted(
    uniforms: Floats, mean: Floats, variance: Floats, least: Floats, most: Floats
) -> Floats:
    counts = least.copy()
    for at in range(mean.size):
        law = np.zeros((1, int(most[at] - least[at]) + 1))
        fill_matched(mean[at : at + 1], variance[at : at + 1], least[at : at + 1], law)
        left = uniforms[at] - law[0, 0]
        while left > 0 and counts[at] < most[at]:
            counts[at] += 1
            left -= law[0, int(counts[at] - least[at])]
    return counts


@compiled
def fill_matched(mean, variance, least, law):  # type: ignore[no-untyped-def]
    """Fill rows (P, N) with the probabilities of the numbers of events from `least` on."""
    spare = np.empty(law.shape[1])
    for at in range(mean.size):
        m, v, row = mean[at], variance[at], law[at]
        if m == 0:
            row[0] = 1.0
        elif v >= m:
            _add_panjer(m, v, 1.0, least[at], row, spare)
        else:
            _fill_with_binomials(m, v, least[at], row, spare)


@compiled
def _fill_with_binomials(m, v, least, row, spare):  # type: ignore[no-untyped-def]
    trials = np.floor(m * m / (m - v))
    if trials >= m and trials * (m - v) > 0:
        # the variance of both together lies between theirs
        low, high = m - m * m / trials, m - m * m / (trials + 1)
        share = (high - v) / (high - low)
        _add_panjer(m, low, share, least, row, spare)
        _add_panjer(m, high, 1 - share, least, row, spare)
        return
    fraction = m - np.floor(m)
    lowest, trials = fraction * (1 - fraction), np.ceil(m)
    binomial = m - m * m / trials
    share = min(max((v - lowest) / max(binomial - lowest, 1e-300), 0.0), 1.0)
    if share > 0:
        _add_panjer(m, binomial, share, least, row, spare)
    place = int(np.floor(m) - least)
    row[place] += (1 - share) * (1 - fraction)
    row[place + 1] += (1 - share) * fraction


@compiled
def _add_panjer(m, v, share, least, row, spare):  # type: ignore[no-untyped-def]
    if v <= 1e-12 * m:  # as many events as trials
        row[int(np.rint(m) - least)] += share
        return
    alpha = 1 - m / v
    beta = m * m / v - alpha
    mode = min(int(np.floor(m) - least), row.size - 1)
    spare[mode] = total = 1.0
    for place in range(mode, 0, -1):
        events = least + place
        ratio = alpha * events + beta
        # the quotient does not wait for the previous probability
        spare[place - 1] = spare[place] * (events / ratio) if ratio > 0 else 0.0
        total += spare[place - 1]
    for place in range(mode + 1, row.size):
        # rounding leaves a little after the last trial
        ratio = alpha + beta / (least + place)
        spare[place] = spare[place - 1] * ratio if ratio > 1e-9 else 0.0
        total += spare[place]
    for place in range(row.size):
        row[place] += share * spare[place] / total
