"""Quantiles of the Poisson law against SciPy's distribution function."""

import numpy as np
import pytest
from scipy.special import ndtri, pdtr, pdtrc

from megalopta.sensor.sampling.quantile import (
    SMALLEST_MEAN,
    doubt,
    exact_quantile,
    fill_quantiles,
    place,
)

MEANS = [*np.linspace(SMALLEST_MEAN, 30, 300), *np.geomspace(30, 1e4, 60)]


def steps(mean):
    """Counts n, and the normal numbers at which the quantile steps from n to n + 1."""
    counts = np.arange(max(0, int(mean - 9 * mean**0.5)), int(mean + 12 * mean**0.5) + 9)
    low, high = pdtr(counts, mean), pdtrc(counts, mean)
    z = np.where(low < 0.5, ndtri(low), -ndtri(high))
    known = np.abs(z) < 8  # beyond, SciPy's tail has few digits left
    return counts[known].astype(float), z[known]


@pytest.mark.parametrize("means", np.array_split(MEANS, 6))
def test_the_expansion_is_as_near_to_each_step_as_it_says(means):
    for mean in means:
        counts, z = steps(mean)
        off = [abs(place(at, mean) - (n + 1)) for n, at in zip(counts, z, strict=True)]
        stated = [doubt(at, mean) for at in z]
        rounding = 1e-13 * mean**1.5  # of SciPy's z, some 1e-13 of σ, and of y
        assert np.all(np.array(off) < np.array(stated) + rounding)


@pytest.mark.parametrize("mean", [SMALLEST_MEAN, 4.7, 10.0, 33.3, 1000.0])
def test_counts_on_both_sides_of_each_step_are_exact(mean):
    counts, z = steps(mean)
    near = np.concatenate([z - 1e-9, z + 1e-9])
    expected = np.concatenate([counts, counts + 1])
    found = np.empty_like(near)
    fill_quantiles(near, np.full(near.size, mean), found)
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("mean", [SMALLEST_MEAN, 50.0])
def test_sums_of_probabilities_give_the_count_of_any_number(mean):
    counts, z = steps(mean)
    middles = (z[1:] + z[:-1]) / 2
    np.testing.assert_array_equal([exact_quantile(at, mean) for at in middles], counts[1:])


@pytest.mark.parametrize("mean", [*np.linspace(SMALLEST_MEAN, 9, 26), 30.0, 3e3, 3e6])
def test_counts_grow_with_the_number_and_are_never_negative(mean):
    z = np.linspace(-8.5, 8.5, 40_001)
    counts = np.empty_like(z)
    fill_quantiles(z, np.full(z.size, mean), counts)
    assert counts[0] >= 0
    assert np.all(np.diff(counts) >= 0)


def test_far_tails_end_at_zero_and_go_on():
    means = np.array([SMALLEST_MEAN, SMALLEST_MEAN, 12.0])
    found = np.empty(3)
    fill_quantiles(np.array([-9.0, 9.0, -30.0]), means, found)
    assert found[0] == found[2] == 0
    assert 25 < found[1] < 60
