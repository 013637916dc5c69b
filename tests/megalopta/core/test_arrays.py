import numpy as np
import pytest

from megalopta.core.arrays import mean_and_variance, robust_sigma


def test_spread_is_that_of_normal_numbers_despite_outliers():
    numbers = np.random.default_rng(0).normal(0, 3, 100_000)
    numbers[:1000] = 1e6
    # median absolute deviation of 1e5: standard error 0.37 %, and 1 % of outliers add 1.6 %
    assert robust_sigma(numbers) == pytest.approx(3, rel=0.035)


def test_mean_and_variance_are_those_of_numpy():
    frames = np.random.default_rng(3).integers(0, 255, (20, 4, 5)).astype(np.uint8)
    mean, variance = mean_and_variance(frames)
    np.testing.assert_allclose(mean, frames.mean(axis=0), rtol=1e-14)
    np.testing.assert_allclose(variance, frames.var(axis=0, ddof=1), rtol=1e-12)
