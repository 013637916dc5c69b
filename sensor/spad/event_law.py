"""Distribution of the number of events in an exposure.

    none of the effects, or a gate     Poisson, exact
    non-paralyzable dead time          exact (`effects.nonparalyzable`)
    paralyzable dead time              exact (`_paralyzable`), to 3e-5 in exposures of half a dead
                                       time, 1e-9 from three on
    anything else                      matched in mean and variance

Matched distributions are of Panjer's family, P(n)/P(n−1) = α + β/n with 1 − α = mean/variance:
negative binomial if the variance exceeds the mean. Otherwise they are mixtures of two binomials, or
of a binomial and the two integers next to the mean, with exactly this mean and variance.
"""

import numpy as np
from scipy.special import gammainc, lambertw

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled
from megalopta.sensor.effects.fields import AvalancheEffects

_SIGMAS, _EVENTS, _CLUMPS = 8, 12, 20
# Branches fall as (r·τ·e^(−rτ)/(2πk))^(T/τ).
_BRANCHES, _FEW_BRANCHES, _LONG = 8, 1, 20


def reach_of_events(mean: Floats, variance: Floats) -> Floats:
    """Smallest and largest likely number of events, (2, ...); probability of others 1e-12."""
    sigma = np.sqrt(variance)
    clump = np.maximum(np.divide(variance, mean, out=np.ones_like(mean), where=mean > 0), 1)
    least = np.maximum(np.floor(mean - _SIGMAS * sigma), 0)
    return np.array([least, np.ceil(mean + _SIGMAS * sigma + _EVENTS + _CLUMPS * (clump - 1))])


def event_law(
    arrivals: Floats,
    moments: tuple[Floats, Floats],
    exposure_s: float,
    effects: AvalancheEffects,
    reach: Floats,
    has_law: bool,
) -> Floats:
    """Probability of each number of events, (P, N), from the smallest in reach on.

    Parameters
    ----------
    arrivals : (P,)
        Mean number of detectable photons plus dark counts, without the gate.
    moments : (mean, variance)
        Moments of the events, each (P,).
    exposure_s : float
    effects : AvalancheEffects
    reach : (2, P)
        Result of `reach_of_events`.
    has_law : bool
        True if all pixels have the same dead time and no other effect.
    """
    size = int((reach[1] - reach[0]).max(initial=0)) + 1
    dead, mean, variance = effects.dead_time, *moments
    if has_law and dead.kind == "nonparalyzable":
        fraction = dead.dead_time_s / exposure_s
        return _nonparalyzable(arrivals, fraction, dead.start == "stationary", reach[0], size)
    law = np.zeros((arrivals.size, size))
    if has_law:
        fraction = dead.dead_time_s / exposure_s
        law[arrivals == 0, 0] = 1.0
        for bright in np.unique(arrivals[arrivals > 0]):
            alike = np.flatnonzero(arrivals == bright)
            least = int(reach[0, alike[0]])
            law[alike] = _paralyzable(bright, fraction, dead.start == "stationary", least, size)
    else:
        _fill(mean, variance, np.ascontiguousarray(reach[0]), law)
    return law


def _nonparalyzable(
    arrivals: Floats, dead_fraction: float, is_stationary: bool, least: Floats, size: int
) -> Floats:
    """Differences of P(N >= n), from gammainc."""
    n = least[:, None] + np.arange(size + 1)
    lost = (arrivals * dead_fraction)[:, None]
    left = np.maximum(arrivals[:, None] - (n - 1) * lost, 0)
    reached = gammainc(np.maximum(n, 1e-9), left)
    if is_stationary:  # dead at the start for a time uniform up to the dead time
        blind = _integral(n, left) - _integral(n, np.maximum(left - lost, 0))
        reached = (reached + blind) / (1 + lost)
    reached[n <= 0] = 1.0
    return np.asarray(reached[:, :-1] - reached[:, 1:])


def _integral(n: Floats, upper: Floats) -> Floats:
    """Integral of P(n, y) over y from 0."""
    n = np.maximum(n, 1e-9)
    return np.asarray(upper * gammainc(n, upper) - n * gammainc(n + 1, upper))


def _paralyzable(
    arrivals: float, dead_fraction: float, is_stationary: bool, least: int, size: int
) -> Floats:
    """Fourier transform of the generating function.

    From the Laplace transforms in `effects.paralyzable`, with W_k the branches of Lambert's
    function at a·e^(−a)·(z − 1),

        E[z^N] = Σ_k z·a/(a + W_k)·e^(W_k·T/τ)/(1 + W_k)             live start
        E[z^N] = Σ_k e^(W_k·(T/τ + 1))/(1 + W_k)                     after running for long
    """
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
    return np.asarray(np.fft.irfft((total * z**-least).conj(), points)[:size])


@compiled
def _fill(mean, variance, least, law):  # type: ignore[no-untyped-def]
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
