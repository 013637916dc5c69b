import numpy as np
import pytest
from scipy.stats import norm, poisson

from megalopta import sensor as sensors
from megalopta.sensor.spad.distributions import event_distribution

IDEAL = sensors.changed(sensors.preset("ideal"), exposure_s=1.0)
N = np.arange(400)


def stated(sensor, arrivals, pixels=1):
    mean, variance = sensors.reading_moments(np.full((1, 1, pixels), float(arrivals)), sensor)
    return mean[0, 0], variance[0, 0]


def moments_of(values, probability):
    mean = (values * probability).sum()
    return mean, ((values - mean) ** 2 * probability).sum()


@pytest.mark.parametrize("arrivals", [0.0, 0.2, 3.0, 14.0, 40.0, 200.0])
@pytest.mark.parametrize(
    ("overflow", "read"), [("saturate", lambda n: np.minimum(n, 15)), ("wrap", lambda n: n % 16)]
)
def test_digital_readings_of_poisson_events_are_the_plain_sums(arrivals, overflow, read):
    sensor = sensors.changed(IDEAL, counter=sensors.DigitalCounter(capacity=15, overflow=overflow))
    expected = moments_of(read(N), poisson.pmf(N, arrivals))
    np.testing.assert_allclose(np.ravel(stated(sensor, arrivals)), expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("noise", [0.1, 0.5, 3.0])
def test_noise_of_an_empty_analog_counter_is_cut_at_zero(noise):
    counter = sensors.AnalogCounter(step_v=10e-3, read_noise_v=10e-3 * noise)
    above = norm.sf((np.arange(1, 60) - 0.5) / noise)
    expected = above.sum(), ((2 * np.arange(1, 60) - 1) * above).sum() - above.sum() ** 2
    # fewer than one misread in 10⁵ is left out
    np.testing.assert_allclose(
        np.ravel(stated(sensors.changed(IDEAL, counter=counter), 0.0)), expected, atol=1e-5
    )


@pytest.mark.parametrize("start", ["live", "stationary"])
@pytest.mark.parametrize("kind", ["nonparalyzable", "paralyzable"])
@pytest.mark.parametrize("arrivals", [0.5, 6.0, 40.0, 150.0])
def test_distributions_of_dead_time_have_its_exact_moments(kind, start, arrivals):
    dead = sensors.DeadTime(kind=kind, dead_time_s=0.02, start=start)
    sensor = sensors.changed(IDEAL, dead_time=dead)
    rate = np.array([[[arrivals]]])
    mean, variance = np.array(sensors.event_moments(rate, sensor))[:, 0, 0]
    effects = sensor.avalanche_effects
    first, [probability] = event_distribution(rate[0, 0], mean, variance, 1.0, effects)
    assert probability.sum() == pytest.approx(1, abs=1e-9)
    assert probability.min() > -1e-9
    moments = moments_of(first + np.arange(probability.size), probability)
    np.testing.assert_allclose(moments, (mean[0], variance[0]), rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("variance", [0.21, 0.5, 0.9, 1.7, 4.0])
@pytest.mark.parametrize("mean", [0.3, 1.5, 2.0, 30.4])
def test_matched_distributions_have_any_possible_mean_and_variance(mean, variance):
    # whole numbers about a mean between two cannot vary less
    variance = max(variance * mean, mean % 1 * (1 - mean % 1))
    moments = np.array([mean]), np.array([variance])
    first, [probability] = event_distribution(None, *moments, 1.0, IDEAL.avalanche_effects)
    moments = moments_of(first + np.arange(probability.size), probability)
    np.testing.assert_allclose(moments, (mean, variance), rtol=1e-6)


@pytest.mark.parametrize(
    "effects",
    [
        {"afterpulsing": sensors.Afterpulsing(mean_carriers=0.2, delay_s=2e-3)},
        pytest.param(
            {
                "afterpulsing": sensors.Afterpulsing(mean_carriers=0.2, delay_s=2e-3),
                "dead_time": sensors.DeadTime(kind="nonparalyzable", dead_time_s=2e-3),
            },
            marks=pytest.mark.slow,
        ),
        {
            "gate": sensors.Gate(period_s=0.1, width_s=0.05),
            "dead_time": sensors.DeadTime(kind="paralyzable", dead_time_s=2e-3),
        },
    ],
)
def test_matched_distributions_are_good_to_two_percent_of_a_standard_deviation(effects):
    """Beside a capacity that cuts the distribution in two; the error of drawing is a third of that."""
    sensor = sensors.changed(IDEAL, counter=sensors.DigitalCounter(capacity=15), **effects)
    rate = np.full((1, 200, 200), 15.0 if "gate" not in effects else 30.0)
    counts = sensors.expose_rate(rate, sensor, seed=0, stream="matched").counts
    mean, variance = np.mean(sensors.reading_moments(rate, sensor), axis=(1, 2, 3))
    assert counts.mean() == pytest.approx(mean, abs=0.045 * variance**0.5)
    assert counts.var() == pytest.approx(variance, rel=0.06)
