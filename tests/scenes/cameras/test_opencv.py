"""Calibrated cameras against OpenCV itself, and against their own inverse."""

import numpy as np
import pytest
from pydantic import ValidationError

from megalopta.scenes import OpenCVCamera

from .by_opencv import opencv_points, undistortion_map

SIZE = {"width": 64, "height": 48, "fx_px": 50.0, "fy_px": 52.0, "cx_px": 30.2, "cy_px": 25.7}
BARREL = (-0.28, 0.09, 1.2e-3, -0.8e-3, -0.01)
RATIONAL = (0.4, 0.05, 1e-3, 2e-3, 0.002, 0.75, 0.2, 0.01)
FISHEYE = (-0.02, 0.004, -0.002, 2e-4)
LENSES = {
    "none": {},
    "barrel": {"distortion": BARREL},
    "pincushion": {"distortion": (0.3, 0.02, 0.0, 1e-3, 0.0)},
    "rational": {"distortion": RATIONAL},
    "fisheye": {"fisheye": FISHEYE},
}
EVERY_LENS = pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES)


def camera_of(lens, **changes):
    return OpenCVCamera(**{**SIZE, **lens, **changes})


@EVERY_LENS
def test_points_are_projected_as_by_opencv_half_a_pixel_to_the_left(lens):
    camera = camera_of(lens)
    across = np.random.default_rng(0).uniform(-0.7, 0.7, (500, 2))
    points = np.column_stack([across, np.ones(500)]) * np.linspace(0.5, 4, 500)[:, None]
    # float64 sums of some hundred px in another order
    expected = opencv_points(camera, points) + 0.5
    np.testing.assert_allclose(camera.project(points), expected, rtol=0, atol=1e-9)


@EVERY_LENS
def test_directions_are_those_whose_image_is_the_pixel(lens):
    camera = camera_of(lens)
    directions = camera.directions()
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1, rtol=1e-14)
    # the last of Newton's steps is below 1e-10 of some 50 px, and the error is its square
    centers = camera.pixel_centers()
    np.testing.assert_allclose(camera.project(3 * directions), centers, rtol=0, atol=1e-10)


@EVERY_LENS
def test_the_undistortion_map_is_that_of_opencv(lens):
    camera = camera_of(lens)
    # float32 steps of some 60 px
    expected = undistortion_map(camera)
    np.testing.assert_allclose(camera.undistortion_map(), expected, rtol=0, atol=4e-6)


def test_a_fisheye_sees_behind_its_image_plane():
    camera = camera_of({"fisheye": (0.0,) * 4}, fx_px=16, fy_px=16, cx_px=31.5, cy_px=23.5)
    angle = np.radians([-110, 0, 100])
    points = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=-1)
    expected = np.stack([32 + 16 * angle, np.full(3, 24.0)], axis=-1)
    np.testing.assert_allclose(camera.project(points), expected, atol=1e-12)
    np.testing.assert_allclose(camera.toward(expected), points, atol=1e-12)
    assert np.isnan(camera.project(np.array([0, 0, -1.0]))).all()


def test_points_from_where_the_lens_turns_back_have_no_image():
    camera = camera_of({"distortion": (-0.2, 0.0, 0.0, 0.0, 0.0)})
    turn = (1 / 0.6) ** 0.5  # where 1 - 3·0.2·r² is 0
    points = np.array([[turn - 0.01, 0, 1], [turn + 0.01, 0, 1], [2.2, 0, 1]])
    assert np.isnan(camera.project(points)).all(axis=1).tolist() == [False, True, True]
    # OpenCV shows the last one a second time, inside of the image
    assert 0 < opencv_points(camera, points)[2, 0] < camera.width


@EVERY_LENS
def test_a_finer_camera_and_one_of_fewer_rows_look_along_the_same_directions(lens):
    camera = camera_of(lens)
    image = np.random.default_rng(1).uniform(0, 48, (50, 2))
    seen = camera.toward(image)
    np.testing.assert_allclose(camera.finer(3).toward(3 * image), seen, atol=1e-12)
    np.testing.assert_allclose(camera.with_rows(20).toward(image - [0, 14]), seen, atol=1e-12)


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"distortion": (-0.9, 0.0, 0.0, 0.0, 0.0)}, "distortion .* has no inverse at .* give"),
        ({"fisheye": (-0.9, 0.0, 0.0, 0.0)}, "fisheye .* has no inverse at"),
        ({"distortion": (0.0, 0.0, 0.9, 0.0, 0.0)}, "distortion .* has no inverse at"),
        ({"distortion": (0.1, 0.2)}, "distortion has 2 coefficients: give 5 or 8"),
        ({"fisheye": (0.1,)}, "fisheye has 1 coefficients: give 4"),
        ({"distortion": BARREL, "fisheye": FISHEYE}, "both given: omit one"),
    ],
)
def test_a_lens_without_an_inverse_is_refused(given, reason):
    with pytest.raises(ValidationError, match=reason):
        camera_of(given)
