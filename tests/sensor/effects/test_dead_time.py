"""Dead time against event-by-event simulation, renewal theory and generating functions.

Sampling tests draw 10⁵ exposures with a fixed seed; each compares one number at |z| < 5, which a
correct sampler fails with probability 6e-7.
"""

from functools import cache

import numpy as np
import pytest
from scipy.special import gammainc, lambertw, ndtr
from scipy.stats import chisquare

from megalopta.sensor.effects import paralyzable
from megalopta.sensor.effects.dead_time import (
    DeadTime,
    draw_counts,
    expected_counts,
    moments,
)
from megalopta.sensor.sampling.streams import generator

KINDS = ["ideal", "nonparalyzable", "paralyzable"]
RATE_TIMES_DEAD_TIME = [1e-3, 0.01, 0.1, 0.5, 1.0, 3.0, 10.0]
MEAN_ARRIVALS = [2.0, 30.0, 1000.0]
DRAWS = 100_000


def law(kind, dead_time_s=1.0):
    return DeadTime(kind=kind, dead_time_s=0 if kind == "ideal" else dead_time_s)


def mean_and_variance(kind, a, arrivals):
    """Closed forms for r·τ = a and r·T = arrivals, in units of the dead time."""
    arguments = [a], arrivals / a, law(kind)
    return expected_counts(*arguments)[0], moments(*arguments)[1][0]


@cache
def sampled(kind, a, arrivals):
    rng = generator(1, kind, f"{a} {arrivals}")
    return draw_counts(rng, np.full(DRAWS, a), arrivals / a, law(kind))


def simulated(kind, a, arrivals, exposures):
    """Event by event, all exposures side by side; times in units of the dead time."""
    rng = np.random.default_rng(7)
    exposure = arrivals / a
    now, live_again = np.zeros(exposures), np.zeros(exposures)
    counts = np.zeros(exposures, int)
    while np.any(now <= exposure):
        now += rng.exponential(1 / a, exposures)
        hit = (now >= live_again) & (now <= exposure)
        counts += hit
        blinds = hit if kind == "nonparalyzable" else True
        live_again = np.where(blinds, now + 1, live_again)
    return counts


def nonparalyzable_law(a, arrivals, largest):
    """P(N = 0 … largest) from P(N >= n), an incomplete gamma function."""
    n = np.arange(1, largest + 2)
    reached = gammainc(n, np.maximum(arrivals - (n - 1) * a, 0))
    return -np.diff(np.concatenate(([1.0], reached)))


def paralyzable_law(a, arrivals, size):
    """P(N = 0 … size − 1) from the generating function, for exposures of very many dead times.

    E[z^N] has the Laplace transform (1 − f₁(1−z)/(1−z·f))/s with f = λe^(−sτ)/(s+λe^(−sτ)),
    f₁ = r/(r+s); its rightmost pole is at s·τ = W(b(z−1)), the others have died away.
    """
    z = np.exp(2j * np.pi * np.arange(size) / size)
    w = lambertw(a * np.exp(-a) * (z - 1))
    generating = z * a / ((a + w) * (1 + w)) * np.exp(w * arrivals / a)
    return np.fft.fft(generating).real / size


@pytest.mark.parametrize("arrivals", MEAN_ARRIVALS)
@pytest.mark.parametrize("a", RATE_TIMES_DEAD_TIME)
@pytest.mark.parametrize("kind", KINDS)
def test_mean_of_draws_matches_closed_form(kind, a, arrivals):
    counts = sampled(kind, a, arrivals)
    mean, variance = mean_and_variance(kind, a, arrivals)
    assert abs(counts.mean() - mean) < 5 * np.sqrt(variance / DRAWS)


@pytest.mark.parametrize("arrivals", MEAN_ARRIVALS)
@pytest.mark.parametrize("a", RATE_TIMES_DEAD_TIME)
@pytest.mark.parametrize("kind", KINDS)
def test_variance_of_draws_matches_closed_form(kind, a, arrivals):
    mean, variance = mean_and_variance(kind, a, arrivals)
    squares = (sampled(kind, a, arrivals) - mean) ** 2
    assert abs(squares.mean() - variance) < 5 * squares.std() / np.sqrt(DRAWS)


@pytest.mark.parametrize("arrivals", [1.0, 30.0])
@pytest.mark.parametrize("a", [0.01, 0.1, 1.0, 5.0])
@pytest.mark.parametrize("kind", ["nonparalyzable", "paralyzable"])
def test_draws_are_as_close_to_event_simulation_as_two_samples_can_be(kind, a, arrivals):
    by_event = simulated(kind, a, arrivals, DRAWS)
    drawn = sampled(kind, a, arrivals)
    size = max(by_event.max(), drawn.max()) + 1
    histograms = (np.bincount(counts, minlength=size) for counts in (by_event, drawn))
    first, second = (histogram / DRAWS for histogram in histograms)
    distance = np.abs(first - second).sum() / 2
    # mean of the distance by Jensen's inequality, excess by McDiarmid's with probability 1e-6
    expected = np.sqrt((first + second) / DRAWS).sum() / 2
    assert distance < expected + np.sqrt(14 / DRAWS)


@pytest.mark.parametrize(("a", "arrivals"), [(0.05, 3.0), (0.02, 40.0), (1.0, 600.0), (20.0, 9e3)])
def test_nonparalyzable_draws_follow_the_exact_law(a, arrivals):
    p = nonparalyzable_law(a, arrivals, int(arrivals / a) + 1)
    assert_follows(sampled("nonparalyzable", a, arrivals), p)


@pytest.mark.parametrize(("a", "counts"), [(0.01, 30.0), (0.3, 90.0), (1.0, 60.0), (4.0, 90.0)])
def test_paralyzable_draws_follow_the_exact_law_below_the_switch_over(a, counts):
    arrivals = counts * np.exp(a)
    assert_follows(sampled("paralyzable", a, arrivals), paralyzable_law(a, arrivals, 256))


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
    distance = np.abs(drawn - paralyzable_law(a, arrivals, 256)).sum() / 2
    assert distance < 4e-4


@pytest.mark.parametrize("a", [1e-3, 0.1, 1.0, 10.0, 100.0])
@pytest.mark.parametrize("dead_times", [0.3, 1.0, 1.7, 4.2, 30.5, 1e3, 2e4])
def test_nonparalyzable_moments_are_those_of_the_exact_law(a, dead_times):
    arrivals = a * dead_times
    p = nonparalyzable_law(
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
    p = paralyzable_law(a, arrivals, 256)
    n = np.arange(p.size)
    mean, variance = mean_and_variance("paralyzable", a, arrivals)
    assert mean == pytest.approx((p * n).sum(), rel=1e-9)
    assert variance == pytest.approx((p * (n - mean) ** 2).sum(), rel=1e-9)


def test_paralyzable_mean_is_the_live_start_formula():
    r, exposure, tau = np.array([3.0, 50.0, 200.0, 900.0]), 1.0, 0.01
    formula = r * (exposure - tau) * np.exp(-r * tau) + 1 - np.exp(-r * tau)
    np.testing.assert_allclose(
        expected_counts(r, exposure, law("paralyzable", tau)), formula, rtol=1e-13
    )


def test_exposure_shorter_than_the_dead_time_counts_at_most_once():
    rate = np.array([0.1, 1.0, 10.0])
    for kind in ("nonparalyzable", "paralyzable"):
        mean = expected_counts(rate, 0.9, law(kind))
        np.testing.assert_allclose(mean, 1 - np.exp(-0.9 * rate), rtol=1e-12)
        np.testing.assert_allclose(moments(rate, 0.9, law(kind))[1], mean * (1 - mean), rtol=1e-9)


def stationary(kind):
    return DeadTime(kind=kind, dead_time_s=1.0, start="stationary")


def integral_of_reached(n, x):
    """∫ P(n, y) dy from 0 to x for the incomplete gamma function; 0 for negative x."""
    x = np.maximum(x, 0)
    return x * gammainc(n, x) - n * gammainc(n + 1, x)


def stationary_nonparalyzable_law(a, arrivals, largest):
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
    p = stationary_nonparalyzable_law(a, arrivals, largest)
    n = np.arange(p.size)
    law_of = [a], dead_times, stationary("nonparalyzable")
    # the oracle is a difference of integrals of up to a·dead_times, good to 1e-13 of these
    assert expected_counts(*law_of)[0] == pytest.approx((p * n).sum(), rel=1e-9)
    mean = a / (1 + a) * dead_times
    assert expected_counts(*law_of)[0] == pytest.approx(mean, rel=1e-12)
    variance = (p * (n - mean) ** 2).sum()
    assert moments(*law_of)[1][0] == pytest.approx(variance, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize(("a", "arrivals"), [(0.05, 3.0), (0.02, 40.0), (1.0, 60.0), (5.0, 90.0)])
def test_stationary_nonparalyzable_draws_follow_the_exact_law(a, arrivals):
    p = stationary_nonparalyzable_law(a, arrivals, int(arrivals / a) + 1)
    rate = np.full(DRAWS, a)
    drawn = draw_counts(generator(4), rate, arrivals / a, stationary("nonparalyzable"))
    assert_follows(drawn, p)


@pytest.mark.parametrize("a", [0.01, 0.3, 1.0, 2.0, 4.0])
@pytest.mark.parametrize("dead_times", [0.01, 0.1, 0.5, 1.5, 20.0])
def test_stationary_paralyzable_draws_have_the_closed_form_moments(a, dead_times):
    law_of = np.full(DRAWS, a), dead_times, stationary("paralyzable")
    counts = draw_counts(generator(5), *law_of)
    mean, variance = expected_counts(*law_of)[0], moments(*law_of)[1][0]
    assert mean == pytest.approx(a * dead_times * np.exp(-a), rel=1e-12)
    assert abs(counts.mean() - mean) < 5 * np.sqrt(variance / DRAWS)
    squares = (counts - mean) ** 2
    assert abs(squares.mean() - variance) < 5 * squares.std() / np.sqrt(DRAWS)


@pytest.mark.parametrize("a", RATE_TIMES_DEAD_TIME)
def test_long_exposures_approach_the_stationary_rates(a):
    # dissertation Eq. 2.5 and 2.6 and the stationary variances; the live start adds at most 1 count
    dead_times = 1e9
    mean, variance = mean_and_variance("nonparalyzable", a, a * dead_times)
    assert mean / dead_times == pytest.approx(a / (1 + a), abs=2e-9)
    assert variance / dead_times == pytest.approx(a / (1 + a) ** 3, abs=2e-9)
    mean, variance = mean_and_variance("paralyzable", a, a * dead_times)
    b = a * np.exp(-a)
    assert mean / dead_times == pytest.approx(b, abs=2e-9)
    # a difference of squares of up to 4e8 counts: rounding takes 1e-7 of the mean
    assert variance / dead_times == pytest.approx(b * (1 - 2 * b), abs=1e-7)


def test_paralyzable_count_rate_peaks_at_inverse_dead_time():
    rate = np.linspace(0.5, 2.0, 1501)
    mean = expected_counts(rate, 1e6, law("paralyzable"))
    assert rate[np.argmax(mean)] == pytest.approx(1.0, abs=1e-3)
    assert mean.max() / 1e6 == pytest.approx(1 / np.e, rel=1e-5)


@pytest.mark.parametrize("kind", KINDS)
def test_counts_are_poisson_where_dead_time_is_negligible(kind):
    rate, exposure = np.array([0.3, 20.0, 1e3]), 0.1
    dead_time = law(kind, 1e-15)
    np.testing.assert_allclose(expected_counts(rate, exposure, dead_time), rate * exposure)
    np.testing.assert_allclose(moments(rate, exposure, dead_time)[1], rate * exposure)


@pytest.mark.parametrize("kind", KINDS)
def test_no_arrivals_give_no_counts_and_no_variance(kind):
    dark = np.zeros((2, 3))
    assert np.all(expected_counts(dark, 1.0, law(kind)) == 0)
    assert np.all(moments(dark, 1.0, law(kind))[1] == 0)
    assert np.all(draw_counts(generator(0), dark, 1.0, law(kind)) == 0)


@pytest.mark.parametrize("kind", KINDS)
def test_shape_is_kept_and_same_generator_gives_same_counts(kind):
    rate = np.linspace(0, 500, 24).reshape(2, 3, 4)
    first, second = (draw_counts(generator(5), rate, 1.0, law(kind, 0.01)) for _ in range(2))
    assert first.shape == rate.shape == expected_counts(rate, 1.0, law(kind, 0.01)).shape
    np.testing.assert_array_equal(first, second)


def test_moments_and_draws_stay_finite_for_overwhelming_light():
    bright, dead_time_s = [1e15], 1e-9
    assert draw_counts(generator(0), bright, 1.0, law("paralyzable", dead_time_s))[0] == 1
    count = draw_counts(generator(0), bright, 1.0, law("nonparalyzable", dead_time_s))[0]
    mean = expected_counts(bright, 1.0, law("nonparalyzable", dead_time_s))[0]
    assert count == pytest.approx(mean, rel=1e-9)


@pytest.mark.parametrize("rate", [-1.0, np.nan, np.inf, 1e16])
def test_impossible_rate_is_refused(rate):
    with pytest.raises(ValueError, match="rate_hz"):
        draw_counts(generator(0), [1.0, rate], 1.0, DeadTime())


@pytest.mark.parametrize("exposure_s", [0.0, -1.0, np.nan, np.inf])
def test_impossible_exposure_is_refused(exposure_s):
    with pytest.raises(ValueError, match="exposure_s"):
        expected_counts(1.0, exposure_s, DeadTime())


def test_dead_time_of_zero_is_refused_with_the_way_out():
    with pytest.raises(ValueError, match="kind 'paralyzable'; give a time or use kind 'ideal'"):
        DeadTime(kind="paralyzable")


def test_a_dead_time_too_short_to_divide_by_is_refused():
    with pytest.raises(ValueError, match="below 1e-15 s"):
        DeadTime(kind="paralyzable", dead_time_s=1e-320)


def test_time_that_does_nothing_is_refused():
    with pytest.raises(ValueError, match="1e-06 does nothing with kind 'ideal'; use kind"):
        DeadTime(dead_time_s=1e-6)
