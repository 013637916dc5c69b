import numpy as np
import pytest

from megalopta.flow import triangular_pool
from megalopta.flow.stimuli.resizing import resize, resized_shape


def frames(shape=(3, 251, 251)):
    return np.random.default_rng(0).random(shape)


@pytest.mark.parametrize("size", [60, 120, 240, 251, (7, 100)])
def test_area_keeps_the_total_of_each_frame(size):
    before, after = frames(), resize(frames(), size, "area")
    np.testing.assert_allclose(after.sum(axis=(1, 2)), before.sum(axis=(1, 2)), rtol=1e-12)


def test_area_of_a_whole_ratio_is_the_sum_over_tiles():
    image = frames((12, 20))
    np.testing.assert_allclose(
        resize(image, (4, 5), "area"), image.reshape(4, 3, 5, 4).sum(axis=(1, 3))
    )


@pytest.mark.parametrize("size", [60, 120, 180, 240])
def test_nearest_takes_the_pixel_at_each_center(size):
    index = np.floor((np.arange(size) + 0.5) * 251 / size).astype(int)
    np.testing.assert_array_equal(resize(frames(), size), frames()[:, index][:, :, index])


def test_columns_follow_the_rows_in_proportion():
    assert resized_shape((120, 160), 60) == (60, 80)
    assert resize(frames((2, 120, 160)), 60, "area").shape == (2, 60, 80)


@pytest.mark.parametrize("size", [0, 252, (10, 300), (0, 5)])
def test_enlarging_and_vanishing_are_refused(size):
    with pytest.raises(ValueError, match="choose sizes from 1 px to that of the frames"):
        resize(frames(), size)


def test_five_taps_are_two_running_means_of_three():
    row = np.random.default_rng(0).poisson(40, (7, 1, 16))
    # a triangle is a box convolved with itself
    once = (row[..., :-2] + row[..., 1:-1] + row[..., 2:]) / 3
    twice = (once[..., :-2] + once[..., 1:-1] + once[..., 2:]) / 3
    assert twice.shape == (7, 1, 12)
    np.testing.assert_allclose(triangular_pool(row), twice, rtol=1e-12)


@pytest.mark.parametrize("taps", [4, 0, -1, 17])
def test_kernel_without_a_middle_or_too_long_is_refused(taps):
    with pytest.raises(ValueError, match=f"taps {taps} for rows of 16 px: use an odd number"):
        triangular_pool(np.ones((3, 16)), taps)
