import numpy as np
import pytest

from megalopta.core.arrays import robust_sigma


def test_spread_is_that_of_normal_numbers_despite_outliers():
    numbers = np.random.default_rng(0).normal(0, 3, 100_000)
    numbers[:1000] = 1e6
    # median absolute deviation of 1e5: standard error 0.37 %, and 1 % of outliers add 1.6 %
    assert robust_sigma(numbers) == pytest.approx(3, rel=0.035)
