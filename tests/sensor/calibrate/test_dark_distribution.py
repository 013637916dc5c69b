"""The distribution of dark counts against the sampler of the sensor."""

import numpy as np
import pytest
from scipy.stats import kstest

from megalopta.sensor import DarkCounts
from megalopta.sensor.calibrate.dark_distribution import cumulative, fit_dark_counts
from megalopta.sensor.effects.dark_counts import dark_count_density

DEVICE = DarkCounts(
    bulk_mean_hz_um2=1.2,
    bulk_sigma_hz_um2=0.5,
    hot_fraction=0.1,
    hot_mean_hz_um2=20,
    hot_sigma_hz_um2=25,
)
RATES = dark_count_density(DEVICE, (120, 120), device_seed=1)


def test_cumulative_is_the_distribution_of_drawn_rates():
    # false alarm 1e-6
    assert kstest(RATES.ravel(), lambda x: cumulative(DEVICE, x)).pvalue > 1e-6


def test_a_fit_recovers_the_distribution():
    found = fit_dark_counts(RATES)
    # the share of hot pixels and the ordinary mean within 5 standard errors of 14400 pixels
    assert found.hot_fraction == pytest.approx(0.1, abs=5 * np.sqrt(0.1 * 0.9 / RATES.size))
    assert found.bulk_mean_hz_um2 == pytest.approx(1.2, abs=5 * 0.5 / np.sqrt(RATES.size))
    assert kstest(RATES.ravel(), lambda x: cumulative(found, x)).pvalue > 1e-6


def test_few_pixels_are_refused():
    with pytest.raises(ValueError, match="4 rates; give 12 or more"):
        fit_dark_counts(np.ones((2, 2)))
