import numpy as np
from numba import njit
from scipy.stats import chisquare, norm

from megalopta.sensor.sampling.normals import EDGES, quick_normal, slow_normal
from megalopta.sensor.sampling.streams import generator

DRAWS = 4_000_000


@njit
def drawn(rng, words, edges, numbers):
    slow = 0
    for index, word in enumerate(words):
        numbers[index] = quick_normal(word, edges)
        if np.isnan(numbers[index]):
            numbers[index] = slow_normal(word, edges, rng)
            slow += 1
    return slow


def test_numbers_follow_the_normal_law_up_to_their_tail():
    rng, numbers = generator(0, "normals"), np.empty(DRAWS)
    slow = drawn(rng, rng.bit_generator.random_raw(DRAWS), EDGES, numbers)
    assert 0.01 < slow / DRAWS < 0.02  # 1.5 % with 256 layers
    # bins within layers, across their edges and in the tail, which begins at 3.654
    edges = np.concatenate(([-np.inf], np.linspace(-4.2, 4.2, 169), [np.inf]))
    expected = DRAWS * np.diff(norm.cdf(edges))
    observed = np.histogram(numbers, edges)[0]
    assert chisquare(observed, expected).pvalue > 1e-6  # the false-alarm rate


def test_layers_have_equal_areas():
    heights = np.exp(-(EDGES**2) / 2)
    areas = EDGES[1:-1] * np.diff(heights[1:])
    np.testing.assert_allclose(areas, areas[0], rtol=1e-9)  # of rounding in 255 steps
    np.testing.assert_allclose(EDGES[0] * heights[1], areas[0], rtol=1e-9)
