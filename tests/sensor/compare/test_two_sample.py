"""Tests of pixels against exact ones, and p-values where nothing differs."""

import numpy as np
import pytest
from scipy.stats import binomtest, kstest, norm, ttest_ind

from megalopta.sensor import changed, preset
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.compare.model import Model
from megalopta.sensor.compare.recordings import compare_levels
from megalopta.sensor.compare.two_sample import Sample, difference, mean_test, variance_test

from .faulty import CAMERAS, compared


def test_means_are_tested_as_scipy_does():
    one, other = np.random.default_rng(3).poisson(30.0, (2, 50, 1, 1))
    expected = ttest_ind(one, other, equal_var=False).pvalue
    np.testing.assert_allclose(mean_test(Sample.of(one), Sample.of(other)), expected)


def test_few_counts_are_tested_exactly():
    one, other = np.zeros((50, 1, 1)), np.zeros((100, 1, 1))
    one[:9], other[:4] = 1, 1
    exact = binomtest(9, 13, 1 / 3, "greater").pvalue
    assert mean_test(Sample.of(one), Sample.of(other))[0, 0] == pytest.approx(2 * exact)


@pytest.mark.parametrize("test", [mean_test, variance_test])
def test_p_values_are_even_where_nothing_differs(test):
    rng = np.random.default_rng(8)
    p = test(*map(Sample.of, rng.poisson(30.0, (2, 300, 40, 40))))
    # 1600 p-values: a Kolmogorov distance of 0.07 has a chance below 1e-6
    assert kstest(p.ravel(), "uniform").statistic < 0.07


def test_what_a_calibration_does_not_know_widens_the_interval():
    rng = np.random.default_rng(6)
    one, other = rng.normal(1.1, 1e-6, 20), rng.normal(1.0, 1e-6, 20)
    found = difference("rate", "", one, other, margin=0.05, standard_error=0.05)
    # blocks that hardly scatter: all of the error is the calibration's, and normal but for t
    assert found.p == pytest.approx(2 * norm.sf(2), rel=0.3)
    assert found.high - found.low == pytest.approx(2 * 1.96 * 0.05, rel=0.05)
    assert difference("rate", "", one, other, margin=0.05).p < 1e-12


def test_dark_counts_of_a_calibration_that_is_off_by_its_error_raise_no_alarm():
    rng = np.random.default_rng(7)
    frames, shape, off = 1000, (8, 8), 0.4
    # pixels known to 40 %, and so the mean of 64 to 5 %; it is off by twice that
    expected = rng.poisson(40.0, (frames, *shape)).astype(float)
    captured = rng.poisson(40.0 * (1 + 2 * off / 8), (frames, *shape)).astype(float)
    levels = [Level(captured, 0.1)], [Level(expected, 0.1)]
    sure = compare_levels(*levels, _uniform(8))
    unsure = compare_levels(*levels, _uniform(8), errors=[np.full(shape, off * 40.0)])
    (before, after) = (
        next(each for each in found.differences if each.name == "dark counts")
        for found in (sure, unsure)
    )
    assert before.relative == pytest.approx(after.relative, rel=0.02)
    assert before.p < 1e-3 < after.p


def counted(mean, frames, seed):
    """A dark level of 16 × 16 alike pixels."""
    return [Level(np.random.default_rng(seed).poisson(mean, (frames, 16, 16)), 0.1)]


def test_small_differences_are_equivalent_though_beyond_chance():
    found = compare_levels(counted(40.8, 4000, 1), counted(40.0, 4000, 2), _uniform(16))
    (dark,) = (cause for cause in found.differences if cause.name == "dark counts")
    assert dark.p < 1e-6 and dark.is_equivalent
    assert not found.causes


def test_too_few_frames_are_refused():
    with pytest.raises(ValueError, match="30 frames"):
        compare_levels(counted(40.0, 30, 1), counted(40.0, 100, 2), _uniform(16))


@pytest.mark.parametrize("seeds", [range(3), pytest.param(range(3, 253), marks=pytest.mark.slow)])
def test_p_values_of_one_device_are_even(seeds):
    """Kolmogorov-Smirnov's test, with a false alarm of 1e-6."""
    camera = CAMERAS["counts"]._replace(shape=(12, 12), levels=CAMERAS["counts"].levels[:2])
    found = [compared(seed, camera) for seed in seeds]
    assert kstest([comparison.explained.p for comparison in found], "uniform").pvalue > 1e-6
    # stated at 1 %; 14 alarms of 250 have a chance below 1e-6
    assert sum(bool(comparison.alarms) for comparison in found) < 3 + len(found) // 22


def _uniform(side):
    """An array of 400 Hz of dark counts everywhere, on 1 µm²."""
    sensor = changed(
        preset("ideal"), pitch_m=1e-6, fill_factor=1.0, dark_counts={"bulk_mean_hz_um2": 400.0}
    )
    return Model(sensor, [np.zeros((1, side, side))])
