import numpy as np
import pytest
from scipy.stats import chisquare, poisson

from megalopta.sensor.poisson import draw_poisson
from megalopta.sensor.randomness import generator


@pytest.mark.parametrize("mean", [0.01, 1.0, 9.99, 10.0, 33.3, 400.0])
def test_draws_follow_the_poisson_law(mean):
    counts = draw_poisson(generator(0, "poisson"), np.full(400_000, mean))
    n = np.arange(int(poisson.ppf(1e-4, mean)), int(poisson.isf(1e-4, mean)) + 1)
    expected = poisson.pmf(n, mean) * counts.size
    observed = np.bincount(np.clip(counts, n[0], n[-1]) - n[0], minlength=n.size)
    expected[0] += poisson.cdf(n[0] - 1, mean) * counts.size
    expected[-1] += counts.size - expected.sum()
    assert chisquare(observed, expected).pvalue > 1e-6  # the false-alarm rate


def test_no_light_gives_no_counts_and_huge_means_stay_close():
    np.testing.assert_array_equal(draw_poisson(generator(0), np.zeros(5)), 0)
    counts = draw_poisson(generator(0), np.full(1000, 1e12))
    assert abs(counts.mean() - 1e12) < 5 * np.sqrt(1e12 / 1000)
