"""Information of readings, against sums over distributions that are computed otherwise."""

import numpy as np
import pytest
from scipy.stats import gamma, norm, poisson

from megalopta.sensor import changed, preset
from megalopta.sensor.frame.model import FRAME_PRESETS
from megalopta.sensor.information import information, reading_noise

IDEAL = changed(preset("ideal"), exposure_s=0.01)


def camera(**changes):
    """A frame camera with no other noise than what is given."""
    fields = {"dark": {"mean_e_s": 0.0}, "cic_e": 0.0, "full_well_e": 30000, **changes}
    return changed(FRAME_PRESETS["orca-quest-2"], **fields)


def told(p, slope):
    seen = p > 1e-14
    return np.sum(slope[seen] ** 2 / p[seen])


def of_electrons(mean, of_readings):
    """From distributions (electrons, readings) of what so many electrons are read as."""
    n = np.arange(len(of_readings))
    p, before = poisson.pmf(n, mean), poisson.pmf(n - 1, mean)
    return told(p @ of_readings, (before - p) @ of_readings)


@pytest.mark.parametrize(
    ("light", "noise_e", "cic_e", "well_e"),
    [(0.3, 0.3, 0, 30000), (0.01, 0.3, 0.02, 30000), (3, 1.4, 0, 30000), (28, 0.3, 0, 30),
     (150, 5, 0, 30000), (200, 0.3, 0, 200)],
)  # fmt: skip
def test_a_noisy_reading_tells_as_much_as_the_sum_over_electrons_and_codes(
    light, noise_e, cic_e, well_e
):
    """Rounded to 0.107 electrons; 1 %, and 4 % where a large well is half full."""
    sensor = camera(read={"median_e": noise_e}, cic_e=cic_e, full_well_e=well_e)
    n = np.arange(int(light + 10 * np.sqrt(light) + 20))
    edges = (np.arange(0.5, 100.5 + (n[-1] + 8 * noise_e) / 0.107) - 100) * 0.107
    reached = norm.cdf((edges - np.minimum(n, well_e)[:, np.newaxis]) / noise_e)
    shares = np.diff(reached, axis=1, prepend=0, append=1)
    expected = of_electrons(light + cic_e, shares)
    tolerance = 0.04 if well_e == 200 else 0.01
    assert information(light, sensor) == pytest.approx(expected, rel=tolerance)


@pytest.mark.parametrize(("light", "efficiency"), [(0.03, 0.85), (0.3, 0.79), (3.0, 0.56)])
def test_multiplied_electrons_tell_as_much_as_a_gamma_distribution(light, efficiency):
    """Gain 1000, read noise 45; by Basden et al. (2003). The variance alone gives 0.49 to 0.50."""
    register = {"gain": 1000, "stages": 604, "well_e": 1e6}
    sensor = camera(
        em=register, read={"median_e": 45}, adc={"bits": 16, "e_per_dn": 15, "black_dn": 100}
    )
    step = 15.0
    x = np.arange(-400, 40000 / step * 1.2) * step
    noise = norm.pdf(np.arange(-360, 361, step), scale=45) * step
    shares = [np.where(x == 0, 1.0, 0.0)]
    shares += [np.diff(gamma.cdf(x - step / 2, n, scale=1000), append=1) for n in range(1, 24)]
    expected = of_electrons(light, np.array([np.convolve(row, noise, "same") for row in shares]))
    found = information(light, sensor)
    assert found == pytest.approx(expected, rel=0.015)
    assert light * found == pytest.approx(efficiency, abs=0.01)
    slope, dark = reading_noise(sensor)
    assert (slope, dark) == pytest.approx((sensor.em.excess_noise, 45**2 / 1e6), rel=0.02)


@pytest.mark.parametrize(("light", "capacity"), [(0.3, 1), (2.0, 1), (12.0, 15), (20.0, 15)])
def test_counts_that_saturate_tell_as_much_as_the_censored_poisson_distribution(light, capacity):
    n = np.arange(200)
    shares = np.eye(capacity + 1)[np.minimum(n, capacity)]
    sensor = changed(IDEAL, counter={"capacity": capacity})
    assert information(light, sensor) == pytest.approx(of_electrons(light, shares), rel=0.01)


@pytest.mark.parametrize("light", [0.3, 5.0, 30.0])
def test_dead_time_leaves_the_information_of_the_renewal_process(light):
    """P(N ≥ n) = P(n, a·(1 − (n − 1)·τ/T)) for a live start."""
    sensor = changed(IDEAL, dead_time={"kind": "nonparalyzable", "dead_time_s": 1e-3})

    def distribution(arrivals):
        left = np.maximum(1 - np.arange(12) * 0.1, 0) * arrivals
        return -np.diff(gamma.cdf(left, np.arange(1, 13)), prepend=1, append=0)

    slope = (distribution(light + 1e-4) - distribution(light - 1e-4)) / 2e-4
    expected = told(distribution(light), slope)
    assert information(light, sensor) == pytest.approx(expected, rel=0.01)
