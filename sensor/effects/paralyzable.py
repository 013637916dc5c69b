"""Paralyzable dead time (passive quench): after every arrival the detector is dead for τ.

Poisson arrivals of rate r; one is counted if the gap to the previous arrival exceeds τ. The
detector is live and idle at the start of the exposure T, so the first arrival always counts. With x
= r·T, a = r·τ and q = e^(−a), the expected number of sets of k counts, E[C(N, k)], has the Laplace
transform r^k·q^(k−1)·e^(−(k−1)sτ)·(s + r·q·e^(−sτ)) / (s^(k+1)·(r+s)). Inverted for k = 1 and 2,
with x₁ = max(x − a, 0), x₂ = max(x − 2a, 0) and h(x) = x − 1 + e^(−x),

    E[N]        = 1 − e^(−x) + q·h(x₁)
    E[N(N−1)/2] = q·h(x₁) + q²·(x₂²/2 − h(x₂))

For T > τ the mean is r·(T−τ)·q + 1 − q; for T ≫ τ it is r·T·q (dissertation Eq. 2.5) and the
variance m·(1 − 2·a·q). The mean rate peaks at r = 1/τ: a bright pixel can read dark.

A detector that has run for long saw its last arrival an exponential time before the start. Then

    E[N] = x·q        E[N(N−1)/2] = q²·x₁²/2

for every T.

After a count, the hazard of another is 0 for one dead time and then λ = r·q per second, which
determines the distribution of all gaps between counts. So two rates with the same r·e^(−rτ) differ
only in the wait for the first arrival, and not at all after running for long. A pixel beyond the
peak (a > 1) is drawn with the lower rate of its pair, whose arrivals outnumber its counts by at
most e.

Draws are exact up to 100 expected counts: where hardly any arrival is lost (x·a < ½), from the
distribution of the number m of close arrivals among n, whose gaps are those of n uniform numbers,

    P(m | n) = C(n−1, m)·Σ_i (−1)^i·C(m, i)·(1 − (n−1−m+i)·τ/T)^n

otherwise arrival by arrival. Beyond 100, they are normal with the exact mean and variance and a
Cornish–Fisher term for the third cumulant m·(1 − 3b)², b = a·q, from the large-T limit log E[z^N] →
(T/τ)·W(b·(z−1)), with W Lambert's function. The total variation distance to the exact distribution
is then below 4e-4.
"""

import numpy as np
from scipy.special import lambertw

from megalopta.core.arrays import Floats, Ints
from megalopta.core.compiling import compiled

_HARDLY_ANY_LOST = 0.5

EXACT_UP_TO = 100.0
"""Expected counts above which draws are normal with a skewness term."""


def moments(arrivals: Floats, dead_fraction: Floats, is_stationary: bool) -> tuple[Floats, Floats]:
    """Exact mean and variance of the counts; parameters as for `nonparalyzable.moments`."""
    mean, variance = np.empty_like(arrivals), np.empty_like(arrivals)
    _fill_moments(arrivals, dead_fraction, is_stationary, mean, variance)
    return mean, variance


def draw(
    rng: np.random.Generator, arrivals: Floats, dead_fraction: Floats, is_stationary: bool
) -> Ints:
    """Draw counts; parameters as for `moments`."""
    # the lower a of the two with the same a·e^(−a), at most 1
    a = arrivals * dead_fraction
    lower = a.copy()
    beyond_peak = a > 1
    bright = a[beyond_peak]
    lower[beyond_peak] = -lambertw(-bright * np.exp(-bright), 0).real
    counts: Ints = _draw(rng, arrivals, lower, dead_fraction, is_stationary)
    return counts


@compiled
def approximate_count(z: float, mean: float, variance: float, a: float) -> int:
    """Count at the quantile of a normal number z, for means above `EXACT_UP_TO`."""
    third_cumulant = mean * (1 - 3 * a * np.exp(-a)) ** 2
    sigma = np.sqrt(variance - 1 / 12)  # rounding to integers restores the 1/12
    return int(np.rint(mean + sigma * z + third_cumulant / variance * (z**2 - 1) / 6))


@compiled
def _fill_moments(
    arrivals: Floats, dead_fraction: Floats, is_stationary: bool, mean: Floats, variance: Floats
) -> None:
    for pixel in range(arrivals.size):
        mean[pixel], variance[pixel] = _moments(
            arrivals[pixel], dead_fraction[pixel], is_stationary
        )


@compiled
def _moments(x: float, dead_fraction: float, is_stationary: bool) -> tuple[float, float]:
    a = x * dead_fraction
    q = np.exp(-a)
    once, twice = max(x - a, 0.0), max(x - 2 * a, 0.0)
    if is_stationary:
        mean, pairs = x * q, (q * once) ** 2 / 2
    else:
        later = q * _h(once)
        mean = later + _at_least_one(x)
        pairs = later + q**2 * (twice**2 / 2 - _h(twice))
    return mean, max(2 * pairs + mean - mean**2, 0.0)  # rounding of numbers that hardly vary


@compiled
def _at_least_one(x: float) -> float:
    """Probability of at least one of x expected arrivals; 1 to the last bit beyond 40."""
    return 1.0 if x > 40 else float(-np.expm1(-x))


@compiled
def _h(x: float) -> float:
    return float(x - _at_least_one(x))


@compiled
def _draw(
    rng: np.random.Generator,
    arrivals: Floats,
    lower: Floats,
    dead_fraction: Floats,
    is_stationary: bool,
) -> Ints:
    counts = np.zeros(arrivals.size, np.int64)
    for pixel in range(arrivals.size):
        x = arrivals[pixel]
        a = x * dead_fraction[pixel]
        # the mean exceeds its stationary value by less than 1
        if x * np.exp(-a) > EXACT_UP_TO - 1:
            mean, variance = _moments(x, dead_fraction[pixel], is_stationary)
            if mean > EXACT_UP_TO:
                counts[pixel] = approximate_count(rng.standard_normal(), mean, variance, a)
                continue
        if x > 0:
            counts[pixel] = _draw_exactly(rng, x, a, lower[pixel], is_stationary)
    return counts


@compiled
def _draw_exactly(
    rng: np.random.Generator, x: float, a: float, dead: float, is_stationary: bool
) -> int:
    """Counts of x arrivals; `dead` is the dead time in mean gaps of the lower rate of the pair."""
    idle = rng.standard_exponential() if is_stationary else np.inf
    if x * a < _HARDLY_ANY_LOST and idle > dead:
        arrivals = x * dead / a if is_stationary else x
        return int(_draw_by_loss(rng, arrivals, a / x))
    if is_stationary:
        return int(_draw_by_arrival(rng, x * dead / a, dead, idle))
    left = x - rng.standard_exponential()
    if left < 0:
        return 0
    return 1 + int(_draw_by_arrival(rng, left * dead / a, dead, 0.0))


@compiled
def _draw_by_arrival(rng: np.random.Generator, left: float, dead: float, idle: float) -> int:
    """Counts in the remaining time, the last arrival being `idle` ago; times in mean gaps."""
    counts = 0
    gap = rng.standard_exponential()
    while gap <= left:
        counts += gap + idle > dead
        left -= gap
        idle = 0.0
        gap = rng.standard_exponential()
    return counts


@compiled
def _draw_by_loss(rng: np.random.Generator, arrivals: float, dead_fraction: float) -> int:
    """Counts from a live start: arrivals minus those too close to the previous one."""
    n = rng.poisson(arrivals)
    if n < 2:
        return int(n)
    left = rng.random()
    ways = 1.0
    for lost in range(n):
        probability, sign = 0.0, 1.0
        for closer in range(lost + 1):
            alive = 1 - (n - 1 - lost + closer) * dead_fraction
            probability += sign * max(alive, 0.0) ** n
            sign *= -(lost - closer) / (closer + 1)
        left -= ways * probability
        if left < 0:
            return int(n - lost)
        ways *= (n - 1 - lost) / (lost + 1)
    return 1
