"""Points from stored depth, and their places in the image of every kind of camera."""

import numpy as np
import pytest

from megalopta.dataset.reprojection import View
from megalopta.scenes import OpenCVCamera, PerspectiveCamera, Trajectory
from megalopta.scenes.cameras.panoramic import CylindricalCamera, EquirectangularCamera

LENS = {"fx_px": 30.0, "fy_px": 29.0, "cx_px": 18.3, "cy_px": 15.8}
SIZE = {"width": 40, "height": 30}
CAMERAS = {
    "distorted": OpenCVCamera(**SIZE, **LENS, distortion=(-0.2, 0.03, 1e-3, 1e-3, 0.0)),
    "fisheye": OpenCVCamera(**SIZE, **LENS, fisheye=(0.01, 0.0, 0.0, 0.0)),
    "pinhole": PerspectiveCamera(**SIZE),
    "sphere": EquirectangularCamera(**SIZE),
    "cylinder": CylindricalCamera(**SIZE, fov_deg=200.0),
}


@pytest.mark.parametrize("name", CAMERAS)
def test_depth_leads_to_points_and_back(name):
    camera = CAMERAS[name]
    pose = Trajectory(position_m=(1, 2, 3), look_at_m=(4, 3, 2)).poses()[0]
    view, depth = View(camera, pose, 0.0), np.random.default_rng(0).uniform(1, 9, camera.shape)
    points = pose[:3, 3] + depth[..., None] * view.directions()
    np.testing.assert_allclose(view.depth_of(points), depth, rtol=1e-12)
    np.testing.assert_allclose(view.way_to(view, points, np.isinf(depth)), 0, atol=1e-9)


def test_a_pinhole_sees_a_point_where_similar_triangles_put_it():
    camera = PerspectiveCamera(width=40, height=30, fov_deg=90.0)  # a focal length of 20 px
    here, there = (View(camera, np.eye(4), 0.0) for _ in range(2))
    there.pose[0, 3] = 0.5
    wall = here.directions() * 5.0
    way = here.way_to(there, wall, np.zeros(camera.shape, bool))
    np.testing.assert_allclose(way[..., 0], -20 * 0.5 / 5, rtol=1e-12)
    np.testing.assert_allclose(way[..., 1], 0, atol=1e-12)
