"""Tests of pixels against exact ones, and their p-values where nothing differs."""

import numpy as np
import pytest
from scipy.stats import binomtest, energy_distance, kstest, wasserstein_distance

from megalopta.sensor.compare.two_sample import (
    distances_by_chance,
    histogram_test,
    mean_test,
    variance_test,
)


def test_few_counts_are_tested_exactly():
    one, other = np.zeros((50, 1, 1)), np.zeros((100, 1, 1))
    one[:9], other[:4] = 1, 1
    exact = binomtest(9, 13, 1 / 3, "greater").pvalue
    assert mean_test(one, other)[0, 0] == pytest.approx(2 * exact)


@pytest.mark.parametrize(
    "test", [mean_test, variance_test, lambda one, other: histogram_test(one, other)[0]]
)
def test_p_values_are_even_where_nothing_differs(test):
    rng = np.random.default_rng(8)
    p = test(*rng.poisson(30.0, (2, 300, 40, 40)).astype(float))
    # 1600 p-values: a Kolmogorov distance of 0.07 has a chance below 1e-6
    assert kstest(p.ravel(), "uniform").statistic < 0.07


def test_distances_are_those_of_scipy():
    rng = np.random.default_rng(2)
    one, other = rng.poisson(9.0, (80, 2, 3)), rng.poisson(11.0, (50, 2, 3))
    found = histogram_test(one, other)[1]
    a, b = one[:, 1, 2], other[:, 1, 2]
    assert found.wasserstein[1, 2] == pytest.approx(wasserstein_distance(a, b))
    assert found.energy[1, 2] == pytest.approx(energy_distance(a, b))
    assert np.median(distances_by_chance(one, other).energy) < np.median(found.energy)


def test_histograms_tell_shapes_and_leave_means_to_their_test():
    rng = np.random.default_rng(4)
    same = rng.poisson(30.0, (400, 8, 8)).astype(float)
    moved = rng.poisson(30.0, (400, 8, 8)) + 1.0
    paired = 2.0 * rng.poisson(15.0, (400, 8, 8))
    assert np.median(histogram_test(same, moved)[0]) > 0.2
    assert np.median(histogram_test(same, paired)[0]) < 1e-6
