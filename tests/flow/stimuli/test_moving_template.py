"""Frames of a moving template against direct indexing, and blur against a box convolution."""

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d

from megalopta.flow.stimuli.moving_template import MovingTemplate, blurred, summed


def template(rows=31, columns=70):
    return np.random.default_rng(0).random((rows, columns)) + 0.1


def test_content_moves_right_by_the_velocity_around_the_circle():
    moving = MovingTemplate(template(), velocity_px=3, size=31)
    frames = moving.light(shift_px=0, count=30)
    for t in (0, 1, 29):
        expected = np.roll(template(), 3 * t, axis=1)[:, :31]
        np.testing.assert_allclose(frames[t], expected / expected.sum(), rtol=1e-12)


def test_a_shift_is_where_a_sequence_would_be_later():
    moving = MovingTemplate(template(), velocity_px=3, size=20)
    np.testing.assert_array_equal(moving.light(0, 6)[4:], moving.light(12, 2))


@pytest.mark.parametrize("kind", ["nearest", "area"])
def test_every_frame_holds_the_whole_flux(kind):
    frames = MovingTemplate(template(), 5, 12, kind).light(0, 9)
    np.testing.assert_allclose(frames.sum(axis=(1, 2)), 1, rtol=1e-12)


def test_nearest_takes_the_pixels_of_imresize():
    moving = MovingTemplate(template(251, 251), 0, 60)
    index = np.floor((np.arange(60) + 0.5) * 251 / 60).astype(int)
    expected = template(251, 251)[np.ix_(index, index)]
    np.testing.assert_allclose(moving.light(0, 1)[0], expected / expected.sum(), rtol=1e-12)


@pytest.mark.parametrize("length", [1, 3, 5, 7])
def test_blur_of_odd_length_is_a_box_around_the_circle(length):
    expected = uniform_filter1d(template(), length, axis=1, mode="wrap")
    np.testing.assert_allclose(blurred(template(), length), expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("length", "kernel"),
    [(2, [0.25, 0.5, 0.25]), (4, [0.125, 0.25, 0.25, 0.25, 0.125]), (1.5, [1 / 6, 2 / 3, 1 / 6])],
)
def test_blur_has_the_taps_of_fspecial(length, kernel):
    spike = np.zeros((1, 31))
    spike[0, 15] = 1
    reach = len(kernel) // 2
    taps = blurred(spike, length)[0]
    np.testing.assert_allclose(taps[15 - reach : 16 + reach], kernel, rtol=1e-12)
    assert taps.sum() == pytest.approx(1)


@pytest.mark.parametrize("dtype", [np.uint16, np.float64])
@pytest.mark.parametrize("window", [1, 2, 5])
def test_temporal_pooling_is_the_sum_over_a_sliding_window(dtype, window):
    frames = np.random.default_rng(1).integers(0, 60000, (9, 4, 5)).astype(dtype)
    expected = [frames[t : t + window].sum(axis=0, dtype=float) for t in range(10 - window)]
    np.testing.assert_allclose(summed(frames, window), expected)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"template": np.ones((30, 20))}, "at least as many columns as rows"),
        ({"template": -template()}, "negative or non-finite"),
        ({"template": template() * np.nan}, "negative or non-finite"),
        ({"size": 40}, "size 40 × 40 px"),
    ],
)
def test_what_is_no_stimulus_is_refused(changes, sentence):
    with pytest.raises(ValueError, match=sentence):
        MovingTemplate(**{"template": template(), "velocity_px": 1, "size": 20, **changes})
    dark = template(30, 90)
    dark[:, 30:] = 0
    with pytest.raises(ValueError, match="is black"):
        MovingTemplate(dark, 10, 20).light(0, 9)
    with pytest.raises(ValueError, match="length_px -1"):
        blurred(template(), -1)


@pytest.mark.parametrize("kind", ["nearest", "area"])
def test_light_per_sequence_is_one_on_average_over_a_full_turn_and_differs_by_one_factor(kind):
    pattern = template(30, 90)
    each = MovingTemplate(pattern, 1, 20, kind)
    mean = MovingTemplate(pattern, 1, 20, kind, "per_sequence")
    sums = mean.light(0, 90).sum(axis=(1, 2))
    assert sums.mean() == pytest.approx(1, rel=1e-12)
    assert sums.std() > 1e-3  # frames do differ
    np.testing.assert_allclose(
        mean.light(0, 90) / sums[:, None, None], each.light(0, 90), rtol=1e-12
    )
