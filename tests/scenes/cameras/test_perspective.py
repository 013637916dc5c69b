import numpy as np
import pytest

from megalopta.scenes import (
    CylindricalCamera,
    EquirectangularCamera,
    OpenCVCamera,
    PerspectiveCamera,
)

CAMERA = PerspectiveCamera(width=40, height=30, fov_deg=90)
SPHERE = EquirectangularCamera(width=72, height=36)
CYLINDER = CylindricalCamera(width=72, height=24, lower_deg=-30, upper_deg=60)
PARTIAL = EquirectangularCamera(width=50, height=20, fov_deg=100, lower_deg=-20, upper_deg=60)
SIZE = {"width": 64, "height": 48, "fx_px": 50.0, "fy_px": 52.0, "cx_px": 30.2, "cy_px": 25.7}
BARREL = OpenCVCamera(**SIZE, distortion=(-0.28, 0.09, 1.2e-3, -0.8e-3, -0.01))
FISHEYE = OpenCVCamera(**SIZE, fisheye=(-0.02, 0.004, -0.002, 2e-4))
FULL = EquirectangularCamera(), CylindricalCamera()
CAMERAS = pytest.mark.parametrize(
    "camera", [CAMERA, SPHERE, CYLINDER, PARTIAL, *FULL, BARREL, FISHEYE]
)


def direction(azimuth_deg, elevation_deg):
    """Unit vector in camera axes (+x right, +y down, +z forward)."""
    azimuth, elevation = np.radians(azimuth_deg), np.radians(elevation_deg)
    across = np.cos(elevation)
    return np.array([across * np.sin(azimuth), -np.sin(elevation), across * np.cos(azimuth)])


@CAMERAS
def test_pixel_centers_project_onto_themselves(camera):
    points = 7.3 * camera.directions()
    np.testing.assert_allclose(camera.project(points), camera.pixel_centers(), atol=1e-9)
    np.testing.assert_allclose(camera.displacement(points), 0, atol=1e-9)


def test_field_of_view_ends_at_the_image_edge():
    left, right = CAMERA.project(np.array([[-1.0, 0.0, 1.0], [1.0, 0.0, 1.0]]))
    np.testing.assert_allclose([left[0], right[0]], [0, 40], atol=1e-12)


@pytest.mark.parametrize("azimuth", [-150, -90, 0, 35, 170])
@pytest.mark.parametrize("elevation", [-60, 0, 25, 80])
def test_equirectangular_images_are_linear_in_azimuth_and_elevation(azimuth, elevation):
    expected = [36 + azimuth / 5, 18 - elevation / 5]
    np.testing.assert_allclose(SPHERE.project(direction(azimuth, elevation)), expected, rtol=1e-12)


@pytest.mark.parametrize("azimuth", [-150, 0, 35])
@pytest.mark.parametrize("elevation", [-30, 0, 45, 60])
def test_cylindrical_images_are_linear_in_azimuth_and_tangent_of_elevation(azimuth, elevation):
    low, high, tangent = np.tan(np.radians([-30, 60, elevation]))
    expected = [36 + azimuth / 5, 24 * (high - tangent) / (high - low)]
    image = CYLINDER.project(3 * direction(azimuth, elevation))
    np.testing.assert_allclose(image, expected, rtol=1e-12, atol=1e-12)


def test_the_part_of_a_panorama_ends_at_the_image_edges():
    corners = PARTIAL.project(np.array([direction(-50, 60), direction(50, -20)]))
    np.testing.assert_allclose(corners, [[0, 0], [50, 20]], atol=1e-12)


@pytest.mark.parametrize("camera", [SPHERE, CYLINDER], ids=["sphere", "cylinder"])
def test_a_full_panorama_is_crossed_the_shorter_way(camera):
    turned = np.roll(camera.directions(), -3, axis=1)  # each pixel's point three to the right
    way = camera.displacement(turned)
    np.testing.assert_allclose(way[..., 0], 3, atol=1e-9)
    np.testing.assert_allclose(way[..., 1], 0, atol=1e-9)


def test_a_partial_panorama_is_never_crossed_behind():
    nearly_full = EquirectangularCamera(width=350, height=10, fov_deg=350)
    turned = np.roll(nearly_full.directions(), -3, axis=1)
    np.testing.assert_allclose(nearly_full.displacement(turned)[:, -1, 0], -347, atol=1e-9)


@CAMERAS
def test_the_steepest_tangent_is_the_largest_in_a_level_view(camera):
    x, y, z = np.moveaxis(camera.directions(), -1, 0)
    at_centers = np.abs(y / np.hypot(x, z)).max()
    # Centers lie half a pixel inside of the edge; near the zenith that is most of the tangent.
    assert at_centers < camera.steepest_tangent
    if camera.steepest_tangent < 10:
        assert at_centers > 0.9 * camera.steepest_tangent


def test_depth_is_along_the_axis_of_a_pinhole_and_along_the_ray_of_a_panorama():
    wall = 5 / CAMERA.directions()[..., 2]  # distances to the plane z = 5
    np.testing.assert_allclose(CAMERA.depth(wall), 5, rtol=1e-14)
    np.testing.assert_array_equal(SPHERE.depth(np.full((36, 72), 5.0)), 5)
