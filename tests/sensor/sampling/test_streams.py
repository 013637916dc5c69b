import numpy as np
from numba import njit
from scipy.stats import chisquare, norm

from megalopta.sensor import changed, preset
from megalopta.sensor.sampling.streams import (
    EDGES,
    LANES,
    fill_normals,
    fill_words,
    generator,
    light_key,
    pixel_uniforms,
    sensor_stream,
    word_streams,
)


def test_keys_that_look_alike_give_different_streams():
    alike = [(1, "1"), (1, 1), (11,), (1, "11"), (1, "1", ""), (1, "", "1"), (1, "i1:1")]
    keys = [*alike, (-1, "1"), (2**70, "1")]
    draws = {generator(*key).integers(2**63) for key in keys}
    assert len(draws) == len(keys)


def test_smaller_array_is_the_corner_of_a_larger_one():
    large = pixel_uniforms((150, 70), 5, "pattern")
    np.testing.assert_array_equal(pixel_uniforms((16, 65), 5, "pattern"), large[:16, :65])


def test_pixels_are_uniform_and_distinct():
    # Kolmogorov-Smirnov: 2.75/√n is exceeded with probability 2·exp(−2·2.75²) = 5e-7
    values = np.sort(pixel_uniforms((200, 200), 5, "pattern").ravel())
    distance = np.abs(values - (np.arange(values.size) + 0.5) / values.size).max()
    assert distance < 2.75 / np.sqrt(values.size)
    assert np.unique(values).size == values.size


def test_light_has_a_name_that_rounding_does_not_change():
    light = np.random.default_rng(1).random((3, 40, 50))
    assert light_key(light) == light_key(light * (1 + 1e-12))
    others = light[::-1], light[:, ::-1], light[..., ::-1], light * (1 + 1e-4), light[:1]
    assert len({light_key(light), *map(light_key, others)}) == 6


def test_the_place_of_a_map_does_not_name_draws(tmp_path):
    names = []
    for folder in (tmp_path, tmp_path / 'a "quoted", place'):
        folder.mkdir(exist_ok=True)
        np.save(folder / "dark.npy", np.ones((2, 2)))
        sensor = changed(preset("ideal"), measured={"dark_counts": str(folder / "dark.npy")})
        names.append(sensor_stream("s", sensor, np.ones((2, 2))))
    assert names[0] == names[1] != sensor_stream("s", preset("ideal"), np.ones((2, 2)))


def test_every_lane_is_numpys_generator_of_the_same_state():
    state = word_streams(generator(1))
    before = state.copy()
    words = np.empty((100, LANES), np.uint64)
    fill_words(state, words)
    for lane in range(LANES):
        twin = np.random.SFC64(0)
        twin.state = twin.state | {"state": {"state": before[:, lane].copy()}}
        np.testing.assert_array_equal(twin.random_raw(100), words[:, lane])


DRAWS = 1_600_000


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
    edges = np.concatenate(([-np.inf], np.linspace(-4.2, 4.2, 169), [np.inf]))
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
