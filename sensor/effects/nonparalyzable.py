"""Non-paralyzable dead time (active quench): after every counted event the detector is dead for τ.

Poisson arrivals of rate r; an arrival inside the dead time is lost without effect. The detector is
live and idle at the start of the exposure T, unless stated otherwise. The counts depend on the mean
number of arrivals x = r·T and on a = r·τ. The n-th count comes after n exponential waits and n − 1
dead times, so

    P(N >= n) = P(n, x − (n−1)·a)               P: regularized lower incomplete gamma function

exactly. The moments are sums over it. With f(s) = r·e^(−sτ)/(r+s) that of the time between counts,
their Laplace transforms

    E[N] ↔ r/(r+s) / (s·(1−f))                  E[N(N−1)/2] ↔ f·r/(r+s) / (s·(1−f)²)

have a pole at 0 that gives a straight line in T, and complex poles that give terms decaying at
least as e^(−βT/τ) with β = ½·ln(1 + π²/(a+a²)). Once those are below the rounding of a double, the
line is the exact result. With g = a/(1+a) it is, for live start,

    mean g·T/τ + g²/2            variance g·(1−g)²·T/τ + g²·(3/2 − 8g/3 + 5g²/4)

whose leading terms are r·T/(1+r·τ) (dissertation Eq. 2.6) and r·T/(1+r·τ)³.

A detector that has run for long is live at the start with probability 1/(1+a); otherwise it is dead
for a time uniform up to τ. Then the mean is g·T/τ for every T, and with the live-start mean m(T)

    E[N(N−1)] = 2·(g/τ)·∫₀^(T−τ) m(t) dt ,    settled: variance g·(1−g)²·T/τ + g² − 4g³/3 + g⁴/2

Bound on β: the poles z (in units of 1/τ) obey (z+a)·e^z = a; with z = −β + iθ and |θ| > π this
gives a²·e^(2β) = (a−β)² + θ² > (a−β)² + π², hence (a²+a)·(e^(2β)−1) > π².
"""

import numpy as np
from scipy.special import gammainc

from megalopta.core.arrays import Floats, Ints
from megalopta.core.compiling import compiled

_SETTLED = 45.0
_TAIL = 40
_SHORTEST_LEAP = 16


def moments(arrivals: Floats, dead_fraction: Floats, is_stationary: bool) -> tuple[Floats, Floats]:
    """Exact mean and variance of the counts.

    Parameters
    ----------
    arrivals : (N,) float64
        Mean number of arrivals in the exposure, r·T.
    dead_fraction : (N,) float64
        Dead time over exposure, τ/T.
    is_stationary : bool
        True if the detector has run for long; False if it is live and idle at the start.
    """
    a = arrivals * dead_fraction
    g, exposure = a / (1 + a), 1 / dead_fraction
    if is_stationary:
        mean = g * exposure
        variance = g * (1 - g) ** 2 * exposure + g**2 * (1 - 4 * g / 3 + g**2 / 2)
    else:
        mean = g * exposure + g**2 / 2
        variance = g * (1 - g) ** 2 * exposure + g**2 * (3 / 2 - 8 * g / 3 + 5 * g**2 / 4)
    # β·T/τ < 45, solved for a + a²; the smaller of the two keeps the exponential finite
    early = a + a**2 > np.pi**2 / np.expm1(np.minimum(2 * _SETTLED * dead_fraction, 700.0))
    mean[early], variance[early] = _summed(arrivals[early], a[early], mean[early], is_stationary)
    return mean, variance


def _summed(x: Floats, a: Floats, near: Floats, is_stationary: bool) -> tuple[Floats, Floats]:
    """Mean and variance by sums over P(N >= n), of x arrivals and about `near` counts."""
    # Before the moments settle the variance is below about 10, so beyond `_TAIL` counts from the
    # mean the distribution function is 0 or 1 to the last bit.
    certain = np.maximum(np.floor(near) - _TAIL, 0.0)
    mean, square = np.zeros_like(x), np.zeros_like(x)
    # ∫ P(n, y) dy up to y is y·P(n, y) − n·P(n+1, y)
    left = np.maximum(x - a, 0.0)
    integral = certain * left - certain * ((certain - 1) * a + certain + 1) / 2
    for extra in range(1, 2 * _TAIL + 2):
        count = certain + extra
        if is_stationary:
            waited = np.maximum(left - (count - 1) * a, 0.0)
            integral += waited * gammainc(count, waited) - count * gammainc(count + 1, waited)
        else:
            reached = gammainc(count, np.maximum(x - (count - 1) * a, 0.0))
            mean += reached
            square += (2 * extra - 1) * reached
    if not is_stationary:
        variance = square - mean**2
    else:
        certain, mean = 0 * x, x / (1 + a)
        variance = 2 * integral / (1 + a) + mean - mean**2
    return certain + mean, np.maximum(variance, 0.0)  # of whole dead times it is that of rounding


@compiled
def draw(
    rng: np.random.Generator, arrivals: Floats, dead_fraction: Floats, is_stationary: bool
) -> Ints:
    """Draw counts from the exact distribution; parameters as for `moments`.

    It leaps over many counts at a time (the sum of n exponential waits is a gamma variate), so the
    cost hardly grows with the count. This follows the gamma method for Poisson variates of Ahrens
    and Dieter, Computing 12, 223 (1974).
    """
    counts = np.zeros(arrivals.size, np.int64)
    for pixel in range(arrivals.size):
        a = arrivals[pixel] * dead_fraction[pixel]
        left = arrivals[pixel] - rng.standard_exponential()
        if is_stationary and rng.random() * (1 + a) < a:
            left -= a * rng.random()
        if left >= 0:
            counts[pixel] = 1 + _later_counts(rng, left, a)
    return counts


@compiled
def _later_counts(rng: np.random.Generator, left: float, a: float) -> int:
    """Counts in the remaining time after a count; all times in mean waits."""
    counts = 0
    leap = _safe_leap(left, a)
    while leap >= _SHORTEST_LEAP:
        waits = rng.standard_gamma(float(leap))
        if waits + leap * a > left:
            inside: int = _counts_inside(rng, left, a, leap, waits)
            return counts + inside
        counts += leap
        left -= waits + leap * a
        leap = _safe_leap(left, a)
    left -= a + rng.standard_exponential()
    while left >= 0:
        counts += 1
        left -= a + rng.standard_exponential()
    return counts


@compiled
def _safe_leap(left: float, a: float) -> int:
    expected = left / (1 + a)
    return int(expected - 1.5 * np.sqrt(expected))


@compiled
def _counts_inside(rng: np.random.Generator, left: float, a: float, leap: int, waits: float) -> int:
    """Counts before `left` if `leap` counts take longer, of `waits`: beta fractions, bisected."""
    low, high = 0, leap
    waits_low, waits_high = 0.0, waits
    while high - low > 1:
        span = high - low
        fraction = (left - waits_low - low * a) / (waits_high - waits_low + span * a)
        step = min(max(int(span * fraction), 1), span - 1)
        between = rng.beta(float(step), float(span - step))
        waits_middle = waits_low + (waits_high - waits_low) * between
        if waits_middle + (low + step) * a <= left:
            low, waits_low = low + step, waits_middle
        else:
            high, waits_high = low + step, waits_middle
    return low
