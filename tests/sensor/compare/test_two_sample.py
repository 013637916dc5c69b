"""Tests of pixels against exact ones, and their p-values where nothing differs."""

import numpy as np
import pytest
from scipy.stats import binomtest, kstest

from megalopta.sensor.compare import histogram_test, mean_test, variance_test


def test_few_counts_are_tested_exactly():
    one, other = np.zeros((50, 1, 1)), np.zeros((100, 1, 1))
    one[:9], other[:4] = 1, 1
    exact = binomtest(9, 13, 1 / 3, "greater").pvalue
    assert mean_test(one, other)[0, 0] == pytest.approx(2 * exact)


@pytest.mark.parametrize(
    "test", [mean_test, variance_test, lambda one, other: histogram_test(one, other).p]
)
def test_p_values_are_even_where_nothing_differs(test):
    rng = np.random.default_rng(8)
    p = test(*rng.poisson(30.0, (2, 300, 40, 40)).astype(float))
    # 1600 p-values: a Kolmogorov distance of 0.07 has a chance below 1e-6
    assert kstest(p.ravel(), "uniform").statistic < 0.07
