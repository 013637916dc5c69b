"""Stimuli: moving templates, light and photons, and other sizes."""

import numpy as np
import pytest

from megalopta.flow import triangular_pool
from megalopta.flow.stimuli.moving_template import MovingTemplate, motion_blurred, sum_frames
from megalopta.flow.stimuli.photons import frame_light, resize


def template(rows=31, columns=70):
    return np.random.default_rng(0).random((rows, columns)) + 0.1


def test_content_moves_right_by_the_velocity_around_the_circle():
    moving = MovingTemplate(template(), velocity_px=3, size=31)
    frames = moving.light(shift_px=0, count=30)
    for t in (0, 1, 29):
        expected = np.roll(template(), 3 * t, axis=1)[:, :31]
        np.testing.assert_allclose(frames[t], expected / expected.sum(), rtol=1e-12)


@pytest.mark.parametrize(
    ("length", "kernel"),
    [(2, [0.25, 0.5, 0.25]), (4, [0.125, 0.25, 0.25, 0.25, 0.125]), (1.5, [1 / 6, 2 / 3, 1 / 6])],
)
def test_blur_has_the_taps_of_fspecial(length, kernel):
    spike = np.zeros((1, 31))
    spike[0, 15] = 1
    reach = len(kernel) // 2
    taps = motion_blurred(spike, length)[0]
    np.testing.assert_allclose(taps[15 - reach : 16 + reach], kernel, rtol=1e-12)
    assert taps.sum() == pytest.approx(1)


@pytest.mark.parametrize("dtype", [np.uint16, np.float64])
@pytest.mark.parametrize("window", [1, 2, 5])
def test_temporal_pooling_is_the_sum_over_a_sliding_window(dtype, window):
    frames = np.random.default_rng(1).integers(0, 60000, (9, 4, 5)).astype(dtype)
    expected = [frames[t : t + window].sum(axis=0, dtype=float) for t in range(10 - window)]
    np.testing.assert_allclose(sum_frames(frames, window), expected)


def frames(shape=(6, 40, 50)):
    return np.random.default_rng(0).random(shape)


@pytest.mark.parametrize("size", [60, (7, 100)])
def test_area_keeps_the_total_of_each_frame(size):
    before = frames((3, 251, 251))
    after = resize(before, size, "area")
    np.testing.assert_allclose(after.sum(axis=(1, 2)), before.sum(axis=(1, 2)), rtol=1e-12)


def test_area_of_a_whole_ratio_is_the_sum_over_tiles():
    image = frames((12, 20))
    np.testing.assert_allclose(
        resize(image, (4, 5), "area"), image.reshape(4, 3, 5, 4).sum(axis=(1, 3))
    )


@pytest.mark.parametrize("size", [60, 240])
def test_nearest_takes_the_pixel_at_each_center(size):
    index = np.floor((np.arange(size) + 0.5) * 251 / size).astype(int)
    expected = frames((3, 251, 251))[:, index][:, :, index]
    np.testing.assert_array_equal(resize(frames((3, 251, 251)), size), expected)


def test_five_taps_are_two_running_means_of_three():
    row = np.random.default_rng(0).poisson(40, (7, 1, 16))
    # a triangle is a box convolved with itself
    once = (row[..., :-2] + row[..., 1:-1] + row[..., 2:]) / 3
    twice = (once[..., :-2] + once[..., 1:-1] + once[..., 2:]) / 3
    assert twice.shape == (7, 1, 12)
    np.testing.assert_allclose(triangular_pool(row), twice, rtol=1e-12)


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: frame_light(-frames()), "negative or non-finite"),
        (lambda: frame_light(frames() * np.nan), "negative or non-finite"),
        (lambda: frame_light(np.ones((4, 4))), "give a sequence"),
        (lambda: resize(frames(), (5, 70)), "choose sizes from 1 px to that of the frames"),
        (lambda: MovingTemplate(np.ones((30, 20)), 1, 20), "as many columns as rows"),
        (lambda: MovingTemplate(-template(), 1, 20), "negative or non-finite"),
        (lambda: MovingTemplate(template(), 1, 40), "size 40 × 40 px"),
        (lambda: MovingTemplate(np.eye(30, 90), 40, 20).light(0, 9), "is black"),
        (lambda: motion_blurred(template(), -1), "length_px -1"),
    ],
)
def test_what_is_no_light_is_refused(call, sentence):
    with pytest.raises(ValueError, match=sentence):
        call()
