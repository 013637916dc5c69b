"""Intervals over units: coverage on drawn units, and closed forms."""

import numpy as np
import pytest
from scipy import stats

from megalopta.benchmark.ranking import lowest
from megalopta.benchmark.table import (
    STRETCHES,
    Sums,
    interval,
    mean_of,
    ratio,
    units,
)

RUNS = 400


def sums(errors, blocks=None):
    errors = np.asarray(errors, float)
    return Sums(errors, np.ones(len(errors)) if blocks is None else np.asarray(blocks, float))


def drawn(rng, count, effect):
    """Two methods on units of unequal size and difficulty; the second is worse by `effect`."""
    blocks = rng.integers(5, 60, count)
    hard = rng.lognormal(0, 0.7, count)
    own = rng.lognormal(-0.02, 0.2, (2, count))
    return sums(hard * own[0] * blocks, blocks), sums(effect * hard * own[1] * blocks, blocks)


@pytest.mark.parametrize("count", [6, 14])
def test_95_of_100_intervals_of_a_ratio_hold_it(count):
    """Both methods' own factors have the same mean: the ratio of the expectations is 1.3 (5 σ)."""
    rng, held = np.random.default_rng(0), 0
    for _ in range(RUNS):
        one, other = drawn(rng, count, 1.3)
        found, _ = ratio(other, one)
        held += found.low <= 1.3 <= found.high
    assert held > RUNS * 0.95 - 5 * np.sqrt(RUNS * 0.95 * 0.05)


def test_equal_methods_are_called_different_once_in_twenty():
    rng, sure = np.random.default_rng(1), 0
    for _ in range(RUNS):
        one, other = drawn(rng, 10, 1.0)
        sure += lowest({"a": one, "b": other})[1]
    assert sure < RUNS * 0.05 + 5 * np.sqrt(RUNS * 0.05 * 0.95)


def test_of_small_scatter_it_is_the_interval_of_a_mean():
    """Units of one size whose errors hardly differ: the t-interval of their mean."""
    errors = 1 + 1e-4 * np.random.default_rng(0).normal(size=12)
    found = interval(sums(errors))
    low, high = stats.t.interval(0.95, 11, errors.mean(), stats.sem(errors))
    assert (found.low, found.high) == pytest.approx((low, high), abs=1e-8)


def test_p_is_that_of_the_paired_t_test():
    rng = np.random.default_rng(0)
    one = 1 + 1e-4 * rng.normal(size=12)
    other = one + 1e-4 * (rng.normal(size=12) + 0.5)
    expected = stats.ttest_rel(other, one).pvalue
    assert ratio(sums(other), sums(one))[1] == pytest.approx(expected, rel=1e-3)


def test_draws_are_not_units():
    """Twice as many draws of the same units: sums and blocks double, intervals do not shrink."""
    one, other = drawn(np.random.default_rng(2), 8, 1.2)
    twice = Sums(2 * one.totals, 2 * one.blocks)
    np.testing.assert_allclose(ratio(other, twice)[0], ratio(other, one)[0])


@pytest.mark.parametrize("blocks", [[5, 0, 0], [1000, 1, 1]])
def test_one_unit_alone_has_no_interval(blocks):
    one = sums([3.0, 1.0, 2.0] * np.sign(blocks), blocks)
    assert interval(one).low is None
    assert ratio(one, one) is None
    assert not lowest({"a": one, "b": one})[1]


def test_a_unit_is_a_sequence_and_of_few_sequences_a_stretch():
    of_many = units([sums([1, 2]), sums([3]), sums([4]), sums([5, 5, 5]), sums([6])])
    assert of_many.totals.tolist() == [3, 3, 4, 15, 6]
    assert of_many.blocks.tolist() == [2, 1, 1, 3, 1]
    of_few = units([sums(np.arange(2 * STRETCHES)), sums([7, 8, 9])])
    assert of_few.totals[:3].tolist() == [1, 5, 9]
    assert of_few.totals[STRETCHES : STRETCHES + 3].tolist() == [7, 8, 9]
    assert of_few.totals.sum() == 2 * STRETCHES * (2 * STRETCHES - 1) / 2 + 24
    assert of_few.blocks.sum() == 2 * STRETCHES + 3


@pytest.mark.parametrize("count", [3, 8])
def test_95_of_100_intervals_of_a_mean_of_few_scenes_hold_it(count):
    """Of errors that differ between scenes by a factor of 1.35 (5 σ)."""
    samples = np.random.default_rng(0).lognormal(0, 0.3, (RUNS, count, 1))
    held = sum(low <= np.exp(0.3**2 / 2) <= high for _, low, high in map(mean_of, samples))
    assert held > RUNS * 0.95 - 5 * np.sqrt(RUNS * 0.95 * 0.05)


def test_a_mean_is_over_what_is_known():
    samples = np.array([[1.0, 2.0], [np.nan, 4.0], [np.nan, np.nan]])
    assert mean_of(samples) == interval(Sums(np.array([3.0, 4.0]), np.array([2.0, 1.0])))
    assert np.isnan(mean_of(samples[2:]).value)
