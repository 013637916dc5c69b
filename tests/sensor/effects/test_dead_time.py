"""Dead time against renewal theory and generating functions; `test_physics.py` has brute force.

Sampling tests draw 10⁵ exposures with a fixed seed; each compares one number at |z| < 5, which a
correct sampler fails with probability 6e-7.
"""

from functools import cache

import numpy as np
import pytest
from scipy.special import gammainc, lambertw, ndtr
from scipy.stats import chisquare

from megalopta.sensor.effects import paralyzable
from megalopta.sensor.effects.dead_time import DeadTime, draw_counts, expected_counts, moments
from megalopta.sensor.sampling.streams import generator

KINDS = ["ideal", "nonparalyzable", "paralyzable"]
RATE_TIMES_DEAD_TIME = [0.01, 0.5, 1.0, 10.0]
MEAN_ARRIVALS = [2.0, 1000.0]
DRAWS = 100_000


def dead_time(kind, dead_time_s=1.0):
    return DeadTime(kind=kind, dead_time_s=0 if kind == "ideal" else dead_time_s)


def mean_and_variance(kind, a, arrivals):
    """Closed forms for r·τ = a and r·T = arrivals, in units of the dead time."""
    arguments = [a], arrivals / a, dead_time(kind)
    return expected_counts(*arguments)[0], moments(*arguments)[1][0]


@cache
def sampled(kind, a, arrivals):
    rng = generator(1, kind, f"{a} {arrivals}")
    return draw_counts(rng, np.full(DRAWS, a), arrivals / a, dead_time(kind))


def nonparalyzable_distribution(a, arrivals, largest):
    """P(N = 0 … largest) from P(N >= n), an incomplete gamma function."""
    n = np.arange(1, largest + 2)
    reached = gammainc(n, np.maximum(arrivals - (n - 1) * a, 0))
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


@pytest.mark.parametrize(("a", "arrivals"), [(0.05, 3.0), (0.02, 40.0), (1.0, 600.0), (20.0, 9e3)])
def test_nonparalyzable_draws_follow_the_exact_law(a, arrivals):
    p = nonparalyzable_distribution(a, arrivals, int(arrivals / a) + 1)
    assert_follows(sampled("nonparalyzable", a, arrivals), p)


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
    moments = mean_and_variance("paralyzable", a, arrivals)
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


@pytest.mark.parametrize("a", [1e-3, 0.1, 1.0, 10.0, 100.0])
@pytest.mark.parametrize("dead_times", [0.3, 1.0, 1.7, 4.2, 30.5, 1e3, 2e4])
def test_nonparalyzable_moments_are_those_of_the_exact_law(a, dead_times):
    arrivals = a * dead_times
    p = nonparalyzable_distribution(
        a, arrivals, int(min(dead_times + 1, arrivals + 10 * arrivals**0.5 + 40))
    )
    n = np.arange(p.size)
    mean, variance = mean_and_variance("nonparalyzable", a, arrivals)
    assert mean == pytest.approx((p * n).sum(), rel=1e-9)
    # the oracle's own rounding: differences of incomplete gamma functions good to 1e-13
    assert variance == pytest.approx((p * (n - mean) ** 2).sum(), rel=1e-7, abs=1e-10)


@pytest.mark.parametrize("a", [1e-3, 0.1, 1.0, 4.0])
def test_paralyzable_moments_are_those_of_the_exact_law(a):
    arrivals = 80.0 * np.exp(a)
    p = paralyzable_distribution(a, arrivals, 256)
    n = np.arange(p.size)
    mean, variance = mean_and_variance("paralyzable", a, arrivals)
    assert mean == pytest.approx((p * n).sum(), rel=1e-9)
    assert variance == pytest.approx((p * (n - mean) ** 2).sum(), rel=1e-9)


def test_exposure_shorter_than_the_dead_time_counts_at_most_once():
    rate = np.array([0.1, 1.0, 10.0])
    for kind in ("nonparalyzable", "paralyzable"):
        mean = expected_counts(rate, 0.9, dead_time(kind))
        np.testing.assert_allclose(mean, 1 - np.exp(-0.9 * rate), rtol=1e-12)
        np.testing.assert_allclose(
            moments(rate, 0.9, dead_time(kind))[1], mean * (1 - mean), rtol=1e-9
        )


def stationary(kind):
    return DeadTime(kind=kind, dead_time_s=1.0, start="stationary")


def integral_of_reached(n, x):
    """∫ P(n, y) dy from 0 to x for the incomplete gamma function; 0 for negative x."""
    x = np.maximum(x, 0)
    return x * gammainc(n, x) - n * gammainc(n + 1, x)


def stationary_nonparalyzable_distribution(a, arrivals, largest):
    """P(N = 0 … largest): the wait for the first event is that left of a gap in equilibrium."""
    n = np.arange(1, largest + 2)
    later = integral_of_reached(n, arrivals - n * a)
    sooner = integral_of_reached(n[1:] - 1, arrivals - (n[1:] - 1) * a)
    reached = (np.concatenate(([arrivals], sooner)) - later) / (1 + a)
    return -np.diff(np.concatenate(([1.0], reached)))


@pytest.mark.parametrize("a", [1e-3, 0.1, 1.0, 5.0, 40.0])
@pytest.mark.parametrize("dead_times", [0.3, 1.7, 4.2, 30.5, 1e3])
def test_stationary_nonparalyzable_moments_are_those_of_the_exact_law(a, dead_times):
    arrivals = a * dead_times
    largest = int(min(dead_times + 1, arrivals + 10 * arrivals**0.5 + 40))
    p = stationary_nonparalyzable_distribution(a, arrivals, largest)
    n = np.arange(p.size)
    arguments = [a], dead_times, stationary("nonparalyzable")
    # the oracle is a difference of integrals of up to a·dead_times, good to 1e-13 of these
    assert expected_counts(*arguments)[0] == pytest.approx((p * n).sum(), rel=1e-9)
    mean = a / (1 + a) * dead_times
    assert expected_counts(*arguments)[0] == pytest.approx(mean, rel=1e-12)
    variance = (p * (n - mean) ** 2).sum()
    assert moments(*arguments)[1][0] == pytest.approx(variance, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize(("a", "arrivals"), [(0.05, 3.0), (0.02, 40.0), (1.0, 60.0), (5.0, 90.0)])
def test_stationary_nonparalyzable_draws_follow_the_exact_law(a, arrivals):
    p = stationary_nonparalyzable_distribution(a, arrivals, int(arrivals / a) + 1)
    rate = np.full(DRAWS, a)
    drawn = draw_counts(generator(4), rate, arrivals / a, stationary("nonparalyzable"))
    assert_follows(drawn, p)


@pytest.mark.parametrize("a", [0.01, 1.0, 4.0])
@pytest.mark.parametrize("dead_times", [0.1, 1.5, 20.0])
def test_stationary_paralyzable_draws_have_the_closed_form_moments(a, dead_times):
    arguments = np.full(DRAWS, a), dead_times, stationary("paralyzable")
    counts = draw_counts(generator(5), *arguments)
    mean, variance = expected_counts(*arguments)[0], moments(*arguments)[1][0]
    assert mean == pytest.approx(a * dead_times * np.exp(-a), rel=1e-12)
    assert abs(counts.mean() - mean) < 5 * np.sqrt(variance / DRAWS)
    squares = (counts - mean) ** 2
    assert abs(squares.mean() - variance) < 5 * squares.std() / np.sqrt(DRAWS)


def test_moments_and_draws_stay_finite_for_overwhelming_light():
    bright, dead_time_s = [1e15], 1e-9
    assert draw_counts(generator(0), bright, 1.0, dead_time("paralyzable", dead_time_s))[0] == 1
    count = draw_counts(generator(0), bright, 1.0, dead_time("nonparalyzable", dead_time_s))[0]
    mean = expected_counts(bright, 1.0, dead_time("nonparalyzable", dead_time_s))[0]
    assert count == pytest.approx(mean, rel=1e-9)


@pytest.mark.parametrize("arrivals", MEAN_ARRIVALS)
@pytest.mark.parametrize("a", RATE_TIMES_DEAD_TIME)
@pytest.mark.parametrize("kind", KINDS)
def test_draws_have_the_moments_of_the_closed_form(kind, a, arrivals):
    counts = sampled(kind, a, arrivals)
    mean, variance = mean_and_variance(kind, a, arrivals)
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
