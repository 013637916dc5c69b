"""Brightness and draws. Statistical tests use |z| < 5, which fails with probability 6e-7."""

import numpy as np
import pytest

from megalopta.flow.stimuli.photons import BlackFrameError, divisors, draw_counts, frame_light


def frames(shape=(6, 40, 50)):
    return np.random.default_rng(0).random(shape)


def test_light_per_sequence_keeps_how_frames_grow_and_per_frame_does_not():
    growing = frames() * np.arange(1, 7)[:, None, None]
    light = frame_light(growing)
    assert list(frame_light(np.full((2, 20, 20), 255, np.uint8))) == [255 * 400] * 2
    np.testing.assert_allclose(light, [frame.sum() for frame in growing], rtol=1e-12)
    assert (light / divisors(light, "per_sequence")).mean() == pytest.approx(1)
    np.testing.assert_array_equal(light / divisors(light, "per_sequence"), light / light.mean())
    np.testing.assert_array_equal(light / divisors(light, "per_frame"), 1)


def test_one_black_frame_is_refused_only_where_it_is_to_be_scaled():
    light = np.array([1.0, 0.0, 3.0])
    np.testing.assert_array_equal(divisors(light, "per_sequence"), 4 / 3)
    with pytest.raises(BlackFrameError, match="frame 1 is black"):
        divisors(light, "per_frame")
    with pytest.raises(BlackFrameError):
        divisors(np.zeros(3), "per_sequence")


def test_counts_of_a_frame_do_not_depend_on_the_chunk_it_is_drawn_in():
    means = 5 * frames()
    whole = draw_counts(means, 3, "scene", 1)
    parts = [draw_counts(means[i : i + 2], 3, "scene", 1, first_frame=i) for i in (0, 2, 4)]
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_seed_key_and_frame_each_give_another_draw():
    means = np.full((1, 20, 20), 10.0)
    draws = [
        draw_counts(means, 0, "a"),
        draw_counts(means, 1, "a"),
        draw_counts(means, 0, "b"),
        draw_counts(means, 0, "a", first_frame=1),
    ]
    assert len({draw.tobytes() for draw in draws}) == 4


@pytest.mark.slow
@pytest.mark.parametrize(("mean", "dtype"), [(100, np.uint16), (1e5, np.uint32), (1e12, np.uint64)])
def test_counts_have_the_narrowest_type_that_holds_them(mean, dtype):
    counts = draw_counts(np.full((1, 4, 4), float(mean)), 0, "scene")
    assert counts.dtype == dtype
    assert abs(counts.astype(float).mean() - mean) < 5 * np.sqrt(mean / 16)


@pytest.mark.parametrize(
    ("bad", "sentence"),
    [
        (-frames(), "negative or non-finite"),
        (frames() * np.nan, "negative or non-finite"),
        (np.ones((4, 4)), "give a sequence"),
        (np.ones((0, 4, 4)), "give a sequence"),
    ],
)
def test_frames_that_are_no_light_are_refused(bad, sentence):
    with pytest.raises(ValueError, match=sentence):
        frame_light(bad)
