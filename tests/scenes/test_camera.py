import numpy as np
import pytest

from megalopta.scenes.camera import PerspectiveCamera

CAMERA = PerspectiveCamera(width=40, height=30, fov_deg=90)


def test_pixel_centers_project_onto_themselves():
    points = 7.3 * CAMERA.directions()
    np.testing.assert_allclose(CAMERA.project(points), CAMERA.pixel_centers(), atol=1e-12)


def test_field_of_view_ends_at_the_image_edge():
    left, right = CAMERA.project(np.array([[-1.0, 0.0, 1.0], [1.0, 0.0, 1.0]]))
    np.testing.assert_allclose([left[0], right[0]], [0, 40], atol=1e-12)


def test_intrinsics_project_like_the_camera():
    point = np.array([0.3, -0.2, 1.7])
    x, y, w = CAMERA.intrinsics @ point
    np.testing.assert_allclose([x / w, y / w], CAMERA.project(point), rtol=1e-12)


def test_points_behind_have_no_image():
    assert np.isnan(CAMERA.project(np.array([0.1, 0.1, -1.0]))).all()


def test_empty_images_and_impossible_views_are_refused():
    with pytest.raises(ValueError, match="width"):
        PerspectiveCamera(width=0)
    with pytest.raises(ValueError, match="fov_deg"):
        PerspectiveCamera(fov_deg=180)
