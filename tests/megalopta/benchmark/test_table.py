"""Intervals over units: coverage on drawn units, and closed forms."""

import numpy as np
import pytest
from scipy import stats

from megalopta.benchmark.table import Sums, interval, means, ratio, samples

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


def is_one_surely_lowest(*methods):
    rows = (
        ("error", str(name), 1.0, "all", unit, *total_and_blocks)
        for name, of_units in enumerate(methods)
        for unit, total_and_blocks in enumerate(zip(*of_units, strict=True))
    )
    return means(samples(rows))["surely_lowest"].any()


@pytest.mark.parametrize("count", [6, 14])
def test_95_of_100_intervals_of_a_ratio_hold_it(count):
    """Both methods' own factors have the same mean: the ratio of the expectations is 1.3 (5 σ)."""
    rng, held = np.random.default_rng(0), 0
    for _ in range(RUNS):
        one, other = drawn(rng, count, 1.3)
        found = ratio(other, one)
        held += found.low <= 1.3 <= found.high
    assert held > RUNS * 0.95 - 5 * np.sqrt(RUNS * 0.95 * 0.05)


def test_equal_methods_are_called_different_once_in_twenty():
    rng, sure = np.random.default_rng(1), 0
    for _ in range(RUNS):
        one, other = drawn(rng, 10, 1.0)
        sure += is_one_surely_lowest(one, other)
    assert sure < RUNS * 0.05 + 5 * np.sqrt(RUNS * 0.05 * 0.95)


def test_of_small_scatter_it_is_the_interval_of_a_mean():
    """Units of one size whose errors hardly differ: the t-interval of their mean."""
    errors = 1 + 1e-4 * np.random.default_rng(0).normal(size=12)
    found = interval(sums(errors))
    low, high = stats.t.interval(0.95, 11, errors.mean(), stats.sem(errors))
    assert (found.low, found.high) == pytest.approx((low, high), abs=1e-8)


@pytest.mark.parametrize("blocks", [[5, 0, 0], [1000, 1, 1]])
def test_one_unit_alone_has_no_interval(blocks):
    one = sums([3.0, 1.0, 2.0] * np.sign(blocks), blocks)
    assert np.isnan(interval(one).low)
    assert ratio(one, one) is None
    assert not is_one_surely_lowest(one, one)


def test_the_table_has_the_mean_of_every_case_over_what_is_known():
    """Three methods on three scenes; b is surely lowest, c is not ranked and a has no blocks."""
    totals = {"a": [0.0, 0.0, 0.0], "b": [1.0, 1.1, 0.9], "c": [0.5, 0.5, 0.5], "d": [2, 2.2, 1.9]}
    case = ("all",)
    table = means(
        samples(
            ("error", name, 10.0, *case, f"scene {unit}", total, float(name != "a"))
            for name, values in totals.items()
            for unit, total in enumerate(values)
        ),
        not_ranked="c",
    )
    assert table["method"].tolist() == ["b", "c", "d"]
    assert table["surely_lowest"].tolist() == [True, False, False]
    expected = interval(sums(totals["d"]))
    assert tuple(table.iloc[2][["value", "low", "high"]]) == pytest.approx(expected)


@pytest.mark.parametrize("count", [3, 8])
def test_95_of_100_intervals_of_a_mean_of_few_scenes_hold_it(count):
    """Of errors that differ between scenes by a factor of 1.35 (5 σ)."""
    errors = np.random.default_rng(0).lognormal(0, 0.3, (RUNS, count))
    held = sum(
        low <= np.exp(0.3**2 / 2) <= high for _, low, high in map(interval, map(sums, errors))
    )
    assert held > RUNS * 0.95 - 5 * np.sqrt(RUNS * 0.95 * 0.05)


def test_draws_are_not_units():
    """Twice as many draws of the same units: sums and blocks double, intervals do not shrink."""
    one, other = drawn(np.random.default_rng(2), 8, 1.2)
    twice = Sums(2 * one.totals, 2 * one.blocks)
    np.testing.assert_allclose(ratio(other, twice), ratio(other, one))


def test_no_interval_of_a_share_exceeds_all_blocks():
    shares = [0.9, 0.001, 0.001, 0.002, 0.001, 0.001]
    rows = [
        ("share_beyond_3_px", "a", 1, "all", unit, share, 1) for unit, share in enumerate(shares)
    ]
    (row,) = means(samples(rows)).itertuples()
    assert row.low < row.value < row.high == 1
