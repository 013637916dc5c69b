import numpy as np

from megalopta.sensor.sampling.streams import generator, pixel_uniforms


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
