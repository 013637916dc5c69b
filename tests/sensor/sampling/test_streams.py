import numpy as np

from megalopta.sensor import changed, preset
from megalopta.sensor.sampling.streams import generator, light_key, pixel_uniforms, sensor_stream


def test_same_key_gives_same_stream_and_seed_zero_is_a_seed():
    first, second = generator(0, "exposure", "forest", 3), generator(0, "exposure", "forest", 3)
    np.testing.assert_array_equal(first.random(8), second.random(8))


def test_keys_that_look_alike_give_different_streams():
    keys = [
        (1, "1"),
        (1, 1),
        (11,),
        (1, "11"),
        (1, "1", ""),
        (1, "", "1"),
        (1, "i1:1"),
        (-1, "1"),
        (2**70, "1"),
    ]
    draws = {generator(*key).integers(2**63) for key in keys}
    assert len(draws) == len(keys)


def test_numpy_integers_are_integers():
    assert generator(np.int64(3), np.int32(4)).random() == generator(3, 4).random()


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
