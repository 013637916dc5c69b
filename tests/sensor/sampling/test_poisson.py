import numpy as np
import pytest
from scipy.special import ndtri, pdtr, pdtrc
from scipy.stats import chisquare, poisson

from megalopta.sensor import preset
from megalopta.sensor.sampling.poisson import (
    CHANCE_ERROR,
    SMALLEST_MEAN,
    chance,
    draw_poisson,
    fill_bits,
    fill_quantiles,
)
from megalopta.sensor.sampling.streams import generator, word_streams


@pytest.mark.parametrize(
    "mean", [0.01, 0.0625, 0.125, 0.99, 1.0, 3.99, 4.0, 4.5, 9.5, 16.0, 400.0, 2049.0, 2e4, 1e6]
)
def test_draws_follow_the_poisson_law(mean):
    counts = draw_poisson(generator(0, "poisson"), np.full(400_000, mean))
    n = np.arange(int(poisson.ppf(1e-4, mean)), int(poisson.isf(1e-4, mean)) + 1)
    expected = poisson.pmf(n, mean) * counts.size
    observed = np.bincount(np.clip(counts, n[0], n[-1]) - n[0], minlength=n.size)
    expected[0] += poisson.cdf(n[0] - 1, mean) * counts.size
    expected[-1] += counts.size - expected.sum()
    assert chisquare(observed, expected).pvalue > 1e-6  # the false-alarm rate


def test_of_fewer_pixels_the_counts_are_the_first_of_more():
    # small and large means mixed within the blocks that are drawn together
    means = np.random.default_rng(5).lognormal(1, 1.5, 5000)
    many = draw_poisson(generator(3), means)
    for size in (1, 700, 1024, 1025, 3333):
        np.testing.assert_array_equal(draw_poisson(generator(3), means[:size]), many[:size])


def test_dark_pixels_among_bright_ones_give_no_counts():
    means = np.tile([0.0, 50.0], 2000)
    assert not draw_poisson(generator(4), means)[::2].any()


@pytest.mark.parametrize("mean", [1e5, 1e9, 9e11, 1e13, 1e15, 9e18])
def test_huge_means_keep_mean_and_variance(mean):
    counts = draw_poisson(generator(0, "huge"), np.full(100_000, mean))
    z = (counts - mean) / np.sqrt(mean)
    # five standard errors of each: false-alarm rate 6e-7
    assert abs(z.mean()) < 5 / np.sqrt(z.size)
    assert z.var() == pytest.approx(1, abs=5 * np.sqrt(2 / z.size))


def test_draws_of_different_means_follow_their_laws_and_are_independent():
    means = np.tile([0.3, 7.6, 0.02, 700.0, 5000.0], 100_000)
    z = (draw_poisson(generator(1, "poisson"), means) - means) / np.sqrt(means)
    z = z.reshape(-1, 5)
    # |z| < 5 of a mean, and of the correlation with the next: false-alarm rate 6e-7 each
    np.testing.assert_allclose(z.mean(axis=0), 0, atol=5 / np.sqrt(len(z)))
    correlation = (z * np.roll(z, 1, axis=1)).mean(axis=0)
    np.testing.assert_allclose(correlation, 0, atol=5 / np.sqrt(len(z)))


def steps(mean):
    """Counts n, and the normal numbers at which the quantile steps from n to n + 1."""
    counts = np.arange(max(0, int(mean - 9 * mean**0.5)), int(mean + 12 * mean**0.5) + 9)
    low, high = pdtr(counts, mean), pdtrc(counts, mean)
    z = np.where(low < 0.5, ndtri(low), -ndtri(high))
    known = np.abs(z) < 8  # beyond, SciPy's tail has few digits left
    return counts[known].astype(float), z[known]


@pytest.mark.parametrize("mean", [*np.linspace(SMALLEST_MEAN, 9, 26), 10.0, 33.3, 1000.0, 1e4])
def test_counts_on_both_sides_of_each_step_are_exact(mean):
    counts, z = steps(mean)
    near = np.concatenate([z - 1e-9, z + 1e-9])
    expected = np.concatenate([counts, counts + 1])
    drawn = np.empty_like(near)
    fill_quantiles(near, np.full(near.size, mean), drawn)
    np.testing.assert_array_equal(drawn, expected)


IDEAL = preset("ideal")


def draw_binary(rng, means):
    packed = np.empty((means.shape[0], -(-means.shape[1] // 8)), np.uint8)
    fill_bits(word_streams(rng), means, np.zeros_like(means), 1.0, packed)
    return packed


def test_chance_is_as_close_as_it_says():
    means = np.concatenate([np.linspace(0, 20, 20_000), np.logspace(-9, 3, 1000)]).astype("f4")
    error = [float(chance(mean)) + np.expm1(-float(mean)) for mean in means]
    assert np.abs(error).max() < CHANCE_ERROR


def test_probability_finer_than_the_sixteen_bits_of_a_lot_is_kept():
    p = 0.4 / 65536
    means = np.full((1000, 1000), -np.log1p(-p))
    ones = sum(int(np.unpackbits(draw_binary(generator(k), means)).sum()) for k in range(5))
    assert abs(ones - 5e6 * p) < 5 * np.sqrt(5e6 * p)  # false alarm 6e-7


def test_packing_is_that_of_numpy_along_the_width_most_significant_bit_first():
    pattern = np.random.default_rng(0).integers(0, 2, (5, 21)).astype(float)
    packed = draw_binary(generator(0), np.where(pattern == 1, np.inf, 0.0))
    np.testing.assert_array_equal(packed, np.packbits(pattern.astype(np.uint8), axis=-1))


def test_the_first_counts_of_many_streams_follow_the_law():
    means = np.array([0.3, 0.03, 2.2, 5.0, 30.0, 3.99, 4.01])
    counts = np.array([draw_poisson(generator(seed), means) for seed in range(20_000)])
    z = (counts.mean(axis=0) - means) / np.sqrt(means / len(counts))
    assert abs(z).max() < 5.5  # seven means: false-alarm rate 3e-7
