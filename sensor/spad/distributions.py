"""Distribution of the number of events of a pixel.

    none of the effects, or a gate     Poisson, exact
    non-paralyzable dead time          exact (`effects.nonparalyzable`)
    paralyzable dead time              exact, to 3e-5 in exposures of half a dead time, 1e-9 from
                                       three on
    anything else                      matched in mean and variance

Matched distributions are of Panjer's family, P(n)/P(n−1) = α + β/n with 1 − α = mean/variance:
negative binomial if the variance exceeds the mean. Otherwise they are mixtures of two binomials, or
of a binomial and the two integers next to the mean, with exactly this mean and variance.
"""

import numpy as np
from scipy.special import gammainc, lambertw

from megalopta.core.arrays import Floats, Ints
from megalopta.core.compiling import compiled
from megalopta.sensor.spad.model import AvalancheEffects

_SIGMAS, _EVENTS, _CLUMPS = 8, 12, 20
_WIDE, _FAR = 25.0, 10.0
"""Variance from which draws are rounded normal numbers, if the mean is so many deviations from 0"""
# Branches fall as (r·τ·e^(−rτ)/(2πk))^(T/τ).
_BRANCHES, _FEW_BRANCHES, _LONG = 8, 1, 20


def likely_events(mean: Floats, variance: Floats) -> Floats:
    """Smallest and largest likely number of events, (2, ...); probability of others 1e-12."""
    sigma = np.sqrt(variance)
    clump = np.maximum(np.divide(variance, mean, out=np.ones_like(mean), where=mean > 0), 1)
    least = np.maximum(np.floor(mean - _SIGMAS * sigma), 0)
    return np.array([least, np.ceil(mean + _SIGMAS * sigma + _EVENTS + _CLUMPS * (clump - 1))])


def event_distribution(
    arrivals: Floats | None,
    mean: Floats,
    variance: Floats,
    exposure_s: float,
    effects: AvalancheEffects,
) -> tuple[Floats, Floats]:
    """Return the probability of each number of events (P, N), and the first number (P,).

    Parameters
    ----------
    arrivals : (P,), optional
        Mean number of photons and dark counts, without the gate, of pixels with the same dead time
        in constant light; None: the distribution is matched.
    mean, variance : (P,)
        Moments of the events.
    """
    first, last = likely_events(mean, variance)
    probability = np.zeros((mean.size, int((last - first).max(initial=0)) + 1))
    if arrivals is None or not effects.is_closed_form:
        _fill_matched(mean, variance, first, probability)
        return first, probability
    fraction = effects.dead_time.dead_time_s / exposure_s
    is_stationary = effects.dead_time.start == "stationary"
    if effects.dead_time.kind == "nonparalyzable":
        n = first[:, None] + np.arange(probability.shape[1] + 1)
        lost = (arrivals * fraction)[:, None]
        left = np.maximum(arrivals[:, None] - (n - 1) * lost, 0)
        reached = gammainc(np.maximum(n, 1e-9), left)
        if is_stationary:  # dead at the start for a time uniform up to the dead time
            waited = _integral(n, left) - _integral(n, np.maximum(left - lost, 0))
            reached = (reached + waited) / (1 + lost)
        reached[n <= 0] = 1.0
        return first, np.asarray(reached[:, :-1] - reached[:, 1:])
    for number in np.unique(arrivals):
        alike = arrivals == number
        probability[alike] = _paralyzable(
            number, fraction, is_stationary, first[alike][0], probability.shape[1]
        )
    return first, probability


def _integral(n: Floats, upper: Floats) -> Floats:
    """Integral of P(n, y) over y from 0."""
    n = np.maximum(n, 1e-9)
    return np.asarray(upper * gammainc(n, upper) - n * gammainc(n + 1, upper))


def _paralyzable(
    arrivals: float, dead_fraction: float, is_stationary: bool, first: float, size: int
) -> Floats:
    """Fourier transform of the generating function.

    From the Laplace transforms in `effects.paralyzable`, with W_k the branches of Lambert's
    function at a·e^(−a)·(z − 1),

        E[z^N] = Σ_k z·a/(a + W_k)·e^(W_k·T/τ)/(1 + W_k)             live start
        E[z^N] = Σ_k e^(W_k·(T/τ + 1))/(1 + W_k)                     after running for long
    """
    if arrivals == 0:
        return np.asarray(np.eye(1, size)[0])
    points = size + 1 - size % 2  # odd, so that −1, where branches may meet, is excluded
    z = np.exp(2j * np.pi * np.arange(points // 2 + 1) / points)
    a = arrivals * dead_fraction
    total = np.zeros(z.size, complex)
    branches = _FEW_BRANCHES if 1 / dead_fraction > _LONG else _BRANCHES
    for branch in range(-branches, branches + 1):
        w = lambertw(a * np.exp(-a) * (z[1:] - 1), branch)
        start = np.exp(w) if is_stationary else z[1:] * a / (a + w)
        total[1:] += start * np.exp(w / dead_fraction) / (1 + w)
    total[0] = 1
    return np.asarray(np.fft.irfft((total * z**-first).conj(), points)[:size])


def draw_matched(rng: np.random.Generator, mean: Floats, variance: Floats) -> Ints:
    """Draw numbers of events (P,); where the variance is large, normal and rounded."""
    normals, uniforms = rng.standard_normal(mean.size), rng.random(mean.size)
    # rounding to integers adds 1/12 to the variance
    counts = np.rint(mean + np.sqrt(np.maximum(variance - 1 / 12, 0)) * normals)
    narrow = np.flatnonzero((variance < _WIDE) | (mean**2 < _FAR**2 * variance))
    least, most = likely_events(mean[narrow], variance[narrow])
    counts[narrow] = _inverted(uniforms[narrow], mean[narrow], variance[narrow], least, most)
    return counts.astype(np.int64)


@compiled
def _inverted(
    uniforms: Floats, mean: Floats, variance: Floats, least: Floats, most: Floats
) -> Floats:
    """Numbers of events up to which the probabilities add up to uniform random numbers."""
    counts = least.copy()
    for pixel in range(mean.size):
        chosen = slice(pixel, pixel + 1)
        probability = np.zeros((1, int(most[pixel] - least[pixel]) + 1))
        _fill_matched(mean[chosen], variance[chosen], least[chosen], probability)
        left = uniforms[pixel] - probability[0, 0]
        while left > 0 and counts[pixel] < most[pixel]:
            counts[pixel] += 1
            left -= probability[0, int(counts[pixel] - least[pixel])]
    return counts


@compiled
def _fill_matched(mean, variance, first, probability):  # type: ignore[no-untyped-def]
    """Fill rows (P, N) with the probabilities of the numbers of events from `first` on."""
    shape = np.empty(probability.shape[1])
    for pixel in range(mean.size):
        m, v, row = mean[pixel], variance[pixel], probability[pixel]
        if m == 0:
            row[0] = 1.0
        elif v >= m:
            _add_panjer(m, v, 1.0, first[pixel], row, shape)
        else:
            _add_binomials(m, v, first[pixel], row, shape)


@compiled
def _add_binomials(m, v, first, row, shape):  # type: ignore[no-untyped-def]
    trials = np.floor(m * m / (m - v))
    if trials >= m and trials * (m - v) > 0:
        # the variance of both together lies between theirs
        low, high = m - m * m / trials, m - m * m / (trials + 1)
        share = (high - v) / (high - low)
        _add_panjer(m, low, share, first, row, shape)
        _add_panjer(m, high, 1 - share, first, row, shape)
        return
    fraction = m - np.floor(m)
    lowest, trials = fraction * (1 - fraction), np.ceil(m)
    binomial = m - m * m / trials
    share = min(max((v - lowest) / max(binomial - lowest, 1e-300), 0.0), 1.0)
    if share > 0:
        _add_panjer(m, binomial, share, first, row, shape)
    place = int(np.floor(m) - first)
    row[place] += (1 - share) * (1 - fraction)
    row[place + 1] += (1 - share) * fraction


@compiled
def _add_panjer(m, v, share, first, row, shape):  # type: ignore[no-untyped-def]
    """Add a distribution of mean m and variance v to a row, times its share."""
    if v <= 1e-12 * m:  # as many events as trials
        row[int(np.rint(m) - first)] += share
        return
    alpha = 1 - m / v
    beta = m * m / v - alpha
    mode = min(int(np.floor(m) - first), row.size - 1)
    shape[mode] = total = 1.0
    for place in range(mode, 0, -1):
        events = first + place
        ratio = alpha * events + beta
        # the quotient does not wait for the previous probability
        shape[place - 1] = shape[place] * (events / ratio) if ratio > 0 else 0.0
        total += shape[place - 1]
    for place in range(mode + 1, row.size):
        # rounding leaves a little after the last trial
        ratio = alpha + beta / (first + place)
        shape[place] = shape[place - 1] * ratio if ratio > 1e-9 else 0.0
        total += shape[place]
    for place in range(row.size):
        row[place] += share * shape[place] / total
