import numpy as np

from megalopta.sensor.sampling.streams import generator
from megalopta.sensor.sampling.words import LANES, fill_words, word_streams


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
