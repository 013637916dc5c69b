"""Points from stored depth, and their places in the image of a calibrated camera."""

import numpy as np
import pytest

from megalopta.dataset.reprojection import View
from megalopta.scenes import OpenCVCamera, Trajectory

SIZE = {"width": 40, "height": 30, "fx_px": 30.0, "fy_px": 29.0, "cx_px": 18.3, "cy_px": 15.8}


@pytest.mark.parametrize(
    "lens", [{"distortion": (-0.2, 0.03, 1e-3, 1e-3, 0.0)}, {"fisheye": (0.01, 0.0, 0.0, 0.0)}]
)
def test_depth_of_a_calibrated_camera_leads_to_points_and_back(lens):
    pose = Trajectory(position_m=(1, 2, 3), look_at_m=(4, 3, 2)).poses()[0]
    view = View(OpenCVCamera(**SIZE, **lens), pose, 0.0)
    depth = np.random.default_rng(0).uniform(1, 9, (30, 40))
    points = pose[:3, 3] + depth[..., None] * view.directions()
    np.testing.assert_allclose(view.depth_of(points), depth, rtol=1e-12)
    np.testing.assert_allclose(view.way_to(view, points, np.isinf(depth)), 0, atol=1e-9)
