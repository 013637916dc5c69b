"""Dead time against renewal theory and generating functions; `test_physics.py` has brute force.

Sampling tests draw 10⁵ exposures with a fixed seed; each compares one number at |z| < 5, which a
correct sampler fails with probability 6e-7.
"""

from functools import cache
from itertools import product

import numpy as np
import pytest
from scipy.special import gammainc, lambertw, ndtr
from scipy.stats import chisquare

from megalopta.sensor.effects import paralyzable
from megalopta.sensor.effects.dead_time import DeadTime, draw_counts, moments
from megalopta.sensor.sampling.streams import generator

DRAWS = 100_000
DRAWN = [
    *product(("ideal", "nonparalyzable", "paralyzable"), (0.01, 0.5, 1, 10), (2, 1000), ("live",)),
    *(("paralyzable", a, a * n, "stationary") for a in (0.01, 1, 4) for n in (0.1, 1.5, 20)),
]


def dead_time(kind, start="live", dead_time_s=1.0):
    return DeadTime(kind=kind, dead_time_s=0 if kind == "ideal" else dead_time_s, start=start)


def stated(kind, a, arrivals, start="live"):
    """Mean and variance for r·τ = a and r·T = arrivals, in units of the dead time."""
    mean, variance = moments([a], arrivals / a, dead_time(kind, start))
    return mean[0], variance[0]


@cache
def sampled(kind, a, arrivals, start="live"):
    rng = generator(1, kind, f"{a} {arrivals} {start}")
    return draw_counts(rng, np.full(DRAWS, a), arrivals / a, dead_time(kind, start))


def integral_of_reached(n, x):
    """∫ P(n, y) dy from 0 to x for the incomplete gamma function; 0 for negative x."""
    x = np.maximum(x, 0)
    return x * gammainc(n, x) - n * gammainc(n + 1, x)


def nonparalyzable_distribution(a, arrivals, start):
    """P(N = 0, 1, …) from P(N >= n), an incomplete gamma function.

    After a long run, the wait for the first event is that left of a gap in equilibrium.
    """
    largest = int(min(arrivals / a + 1, arrivals + 10 * arrivals**0.5 + 40))
    n = np.arange(1, largest + 2)
    if start == "live":
        reached = gammainc(n, np.maximum(arrivals - (n - 1) * a, 0))
    else:
        later = integral_of_reached(n, arrivals - n * a)
        sooner = integral_of_reached(n[1:] - 1, arrivals - (n[1:] - 1) * a)
        reached = (np.concatenate(([arrivals], sooner)) - later) / (1 + a)
    return -np.diff(np.concatenate(([1.0], reached)))


def paralyzable_distribution(a, arrivals, size):
    """P(N = 0 … size − 1) from the generating function, for exposures of very many dead times.

    E[z^N] has the Laplace transform (1 − f₁(1−z)/(1−z·f))/s with f = λe^(−sτ)/(s+λe^(−sτ)),
    f₁ = r/(r+s); its rightmost pole is at s·τ = W(b(z−1)), the others have died away.
    """
    z = np.exp(2j * np.pi * np.arange(size) / size)
    w = lambertw(a * np.exp(-a) * (z - 1))
    generating = z * a / ((a + w) * (1 + w)) * np.exp(w * arrivals / a)
    return np.fft.fft(generating).real / size


@pytest.mark.parametrize(
    ("a", "arrivals"), [(0.05, 3.0), (0.02, 40.0), (1.0, 60.0), (1.0, 600.0), (20.0, 9e3)]
)
@pytest.mark.parametrize("start", ["live", "stationary"])
def test_nonparalyzable_draws_follow_the_exact_law(a, arrivals, start):
    p = nonparalyzable_distribution(a, arrivals, start)
    assert_follows(sampled("nonparalyzable", a, arrivals, start), p)


@pytest.mark.parametrize(("a", "counts"), [(0.01, 30.0), (0.3, 90.0), (1.0, 60.0), (4.0, 90.0)])
def test_paralyzable_draws_follow_the_exact_law_below_the_switch_over(a, counts):
    arrivals = counts * np.exp(a)
    assert_follows(sampled("paralyzable", a, arrivals), paralyzable_distribution(a, arrivals, 256))


def assert_follows(counts, p):
    """Pearson's test with at least 10 expected in every bin; false alarm 1e-6."""
    assert p.sum() == pytest.approx(1, abs=1e-9)
    common = np.flatnonzero(p * DRAWS >= 10)
    low, high = common[0], common[-1]
    clipped = np.bincount(np.clip(counts, low, high) - low, minlength=high - low + 1)
    expected = p[low : high + 1] * DRAWS
    expected[0] += p[:low].sum() * DRAWS
    expected[-1] += DRAWS - expected.sum()
    assert chisquare(clipped, expected).pvalue > 1e-6


@pytest.mark.parametrize("a", [1e-3, 0.1, 0.3, 1.0, 2.0, 5.0])
def test_paralyzable_normal_draws_are_within_4e4_of_the_exact_law_at_the_switch_over(a):
    arrivals = (paralyzable.EXACT_UP_TO + 0.1) * np.exp(a)
    moments = stated("paralyzable", a, arrivals)
    counts = np.arange(256)
    # counts grow with z: where each is exceeded, by bisection to 16/2⁴⁰
    low, high = np.full(256, -8.0), np.full(256, 8.0)
    for _ in range(40):
        middle = (low + high) / 2
        exceeds = [paralyzable.approximate_count(z, *moments, a) for z in middle] > counts
        low, high = np.where(exceeds, low, middle), np.where(exceeds, middle, high)
    drawn = np.diff(ndtr(high), prepend=0)
    distance = np.abs(drawn - paralyzable_distribution(a, arrivals, 256)).sum() / 2
    assert distance < 4e-4


def assert_moments(p, mean, variance, error):
    n = np.arange(p.size)
    assert mean == pytest.approx((p * n).sum(), rel=1e-9)
    assert variance == pytest.approx((p * (n - mean) ** 2).sum(), rel=error, abs=1e-9)


@pytest.mark.parametrize("a", [1e-3, 0.1, 1.0, 10.0, 100.0])
@pytest.mark.parametrize("dead_times", [0.3, 1.0, 1.7, 4.2, 30.5, 1e3, 2e4])
@pytest.mark.parametrize("start", ["live", "stationary"])
def test_nonparalyzable_moments_are_those_of_the_exact_law(a, dead_times, start):
    if start == "stationary" and a * dead_times > 5e4:
        pytest.skip("the oracle, a difference of integrals, loses its digits")
    mean, variance = stated("nonparalyzable", a, a * dead_times, start)
    # the oracle's own rounding: differences of incomplete gamma functions good to 1e-13
    error = 1e-7 if start == "live" else 1e-6
    assert_moments(nonparalyzable_distribution(a, a * dead_times, start), mean, variance, error)
    if start == "stationary":
        assert mean == pytest.approx(a / (1 + a) * dead_times, rel=1e-12)


@pytest.mark.parametrize("a", [1e-3, 0.1, 1.0, 4.0])
def test_paralyzable_moments_are_those_of_the_exact_law(a):
    arrivals = 80.0 * np.exp(a)
    p = paralyzable_distribution(a, arrivals, 256)
    assert_moments(p, *stated("paralyzable", a, arrivals), 1e-9)


@pytest.mark.parametrize("kind", ["nonparalyzable", "paralyzable"])
def test_exposure_shorter_than_the_dead_time_counts_at_most_once(kind):
    rate = np.array([0.1, 1.0, 10.0])
    mean, variance = moments(rate, 0.9, dead_time(kind))
    np.testing.assert_allclose(mean, 1 - np.exp(-0.9 * rate), rtol=1e-12)
    np.testing.assert_allclose(variance, mean * (1 - mean), rtol=1e-9)


def test_moments_and_draws_stay_finite_for_overwhelming_light():
    passive, active = (dead_time(kind, "live", 1e-9) for kind in ("paralyzable", "nonparalyzable"))
    assert draw_counts(generator(0), [1e15], 1.0, passive)[0] == 1
    count, (mean, _) = draw_counts(generator(0), [1e15], 1.0, active), moments([1e15], 1.0, active)
    assert count[0] == pytest.approx(mean[0], rel=1e-9)


@pytest.mark.parametrize(("kind", "a", "arrivals", "start"), DRAWN)
def test_draws_have_the_moments_of_the_closed_form(kind, a, arrivals, start):
    counts = sampled(kind, a, arrivals, start)
    mean, variance = stated(kind, a, arrivals, start)
    if start == "stationary":
        assert mean == pytest.approx(arrivals * np.exp(-a), rel=1e-12)
    assert abs(counts.mean() - mean) < 5 * np.sqrt(variance / DRAWS)
    squares = (counts - mean) ** 2
    assert abs(squares.mean() - variance) < 5 * squares.std() / np.sqrt(DRAWS)


@pytest.mark.parametrize(
    ("rate_hz", "exposure_s", "fields", "message"),
    [
        *((rate, 1.0, {}, "rate_hz") for rate in (-1.0, np.nan, np.inf, 1e16)),
        *((1.0, exposure_s, {}, "exposure_s") for exposure_s in (0.0, -1.0, np.nan, np.inf)),
        (1.0, 1.0, {"kind": "paralyzable"}, "kind 'paralyzable'; give a time or use kind 'ideal'"),
        (1.0, 1.0, {"kind": "paralyzable", "dead_time_s": 1e-320}, "below 1e-15 s"),
        (1.0, 1.0, {"dead_time_s": 1e-6}, "1e-06 has no effect with kind 'ideal'; use kind"),
    ],
)
def test_impossible_rates_exposures_and_times_are_refused(rate_hz, exposure_s, fields, message):
    with pytest.raises(ValueError, match=message):
        draw_counts(generator(0), [1.0, rate_hz], exposure_s, DeadTime(**fields))


@pytest.mark.parametrize(
    ("kind", "start"), [*product(("nonparalyzable", "paralyzable"), ("live", "stationary"))]
)
def test_moments_hold_where_nearly_whole_dead_times_fill_the_exposure(kind, start):
    dead, rate_hz = dead_time(kind, start, 5.999389e-8), np.geomspace(1e7, 1e14, 400)
    mean, variance = moments(rate_hz, 1e-4, dead)
    assert variance.min() >= 0
    for at in range(0, 400, 57):
        counts = draw_counts(generator(2, kind, f"{at}"), np.full(20_000, rate_hz[at]), 1e-4, dead)
        assert abs(counts.mean() - mean[at]) <= 5 * np.sqrt(variance[at] / 20_000) + 1e-3
        # 20 000 draws: 5 errors of the variance of normal counts are 5 %, of two numbers as much
        assert counts.var() == pytest.approx(variance[at], rel=0.06, abs=2e-3)
