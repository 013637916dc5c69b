import numpy as np
from numba import njit
from scipy.stats import chisquare, norm

from megalopta.sensor.sampling.streams import (
    EDGES,
    LANES,
    fill_normals,
    fill_words,
    generator,
    word_streams,
)


def test_every_lane_is_numpys_generator_of_the_same_state():
    state = word_streams(generator(1))
    before = state.copy()
    words = np.empty((100, LANES), np.uint64)
    fill_words(state, words)
    for lane in range(LANES):
        twin = np.random.SFC64(0)
        twin.state = twin.state | {"state": {"state": before[:, lane].copy()}}
        np.testing.assert_array_equal(twin.random_raw(100), words[:, lane])


def test_the_source_goes_on_where_it_stopped():
    parts, whole = word_streams(generator(1)), word_streams(generator(1))
    all_words, words = np.empty((7, LANES), np.uint64), np.empty((7, LANES), np.uint64)
    fill_words(whole, all_words)
    fill_words(parts, words[:3])
    fill_words(parts, words[3:])
    np.testing.assert_array_equal(words, all_words)


DRAWS = 4_000_000


@njit
def drawn(streams, edges, parts):
    words = np.empty((parts.shape[1] // LANES + 1, LANES), np.uint64)
    for numbers in parts:
        fill_normals(streams[0], streams[1], words, edges, numbers)


def normals(seed, parts, size):
    numbers = np.empty((parts, size))
    drawn(word_streams(generator(seed, "normals"), 2), EDGES, numbers)
    return numbers.ravel()


def test_numbers_follow_the_normal_law_up_to_their_tail():
    numbers = normals(0, 4000, DRAWS // 4000)
    # bins within layers, across their edges and in the tail, which begins at 4.039
    edges = np.concatenate(([-np.inf], np.linspace(-4.4, 4.4, 177), [np.inf]))
    expected = DRAWS * np.diff(norm.cdf(edges))
    observed = np.histogram(numbers, edges)[0]
    assert expected.min() > 5
    assert chisquare(observed, expected).pvalue > 1e-6  # the false-alarm rate


def test_numbers_from_the_edges_of_layers_follow_it_too():
    # in bins as narrow as layers, where the few that no layer is certain of would show
    numbers = normals(1, 4000, DRAWS // 4000)
    for low, high in ((0.5, 1.5), (2.5, 3.5)):
        edges = np.linspace(low, high, 201)
        expected = DRAWS * np.diff(norm.cdf(edges))
        z = (np.histogram(numbers, edges)[0] - expected) / np.sqrt(expected)
        assert abs(z).max() < 6  # 400 bins at 2e-9: false-alarm rate 8e-7


def test_the_first_numbers_of_many_are_those_of_few():
    np.testing.assert_array_equal(normals(2, 1, 5000)[:777], normals(2, 1, 777))
