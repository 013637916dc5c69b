"""Statistics of a recording against NumPy's, of one array."""

import numpy as np
import pytest

from megalopta.sensor.calibrate import statistics as module
from megalopta.sensor.calibrate.statistics import LAGS, OFFSETS, both, statistics


@pytest.mark.parametrize("dtype", [np.bool_, np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("block", [1, 2**24])
def test_statistics_are_those_of_numpy(dtype, block, monkeypatch):
    monkeypatch.setattr(module, "BLOCK", block)
    readings = np.random.default_rng(0).poisson(3.0, (53, 5, 7)).astype(dtype)
    readings.flags.writeable = False
    of, numbers = statistics(readings), readings.astype(np.float64)
    apart = numbers - numbers.mean(axis=0)
    np.testing.assert_allclose(of.mean, numbers.mean(axis=0))
    np.testing.assert_allclose(of.variance, numbers.var(axis=0, ddof=1), atol=1e-12)
    np.testing.assert_allclose(of.third, (apart**3).mean(axis=0), atol=1e-10)
    np.testing.assert_array_equal(of.largest, numbers.max(axis=0))
    np.testing.assert_array_equal(of.at_largest, (numbers == numbers.max(axis=0)).sum(axis=0))
    np.testing.assert_allclose(of.of_rows, numbers.mean(axis=2))
    for lag in range(1, LAGS + 1):
        products = (apart[lag:] * apart[:-lag]).sum(axis=0) / 53
        np.testing.assert_allclose(of.later[lag - 1], products, atol=1e-12)
    for covariance, offset in zip(of.neighbors, OFFSETS, strict=True):
        first, second = both(offset)
        products = (apart[:, *first] * apart[:, *second]).sum(axis=0) / 52
        np.testing.assert_allclose(covariance[first], products, atol=1e-12)
        assert np.count_nonzero(covariance) <= products.size
