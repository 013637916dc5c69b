"""Ground truth in distorted images against OpenCV's own projection of the points seen."""

import numpy as np
import pytest

from megalopta.scenes.cameras.opencv import OpenCVCamera
from megalopta.scenes.trajectories.steady import Trajectory

from ..scenes.cameras.by_opencv import opencv_points
from .conftest import quad, renderer_of

SIZE = {"width": 80, "height": 60, "fx_px": 60.0, "fy_px": 58.0, "cx_px": 36.3, "cy_px": 31.8}
CAMERAS = {
    "barrel": OpenCVCamera(**SIZE, distortion=(-0.28, 0.09, 1.2e-3, -0.8e-3, -0.01)),
    "rational": OpenCVCamera(**SIZE, distortion=(0.4, 0.05, 1e-3, 2e-3, 0.002, 0.75, 0.2, 0.01)),
    "fisheye": OpenCVCamera(**SIZE, fisheye=(-0.02, 0.004, -0.002, 2e-4)),
}
PATH = Trajectory(
    frames=2,
    position_m=(0, 0, 2),
    look_at_m=(5, 1, 0),
    rotation_deg_s=20,
    velocity_m_s=(2, -1, 0.5),
)
BOARD = quad(np.array([[3.0, -0.6, 0.3], [3.0, 0.7, 0.3], [3.2, 0.7, 1.6], [3.2, -0.6, 1.6]]))


def seen_by_opencv(camera, points, pose):
    """Image coordinates (n, 2) of points (n, 3), with pixel centers at half integers."""
    return opencv_points(camera, (points - pose[:3, 3]) @ pose[:3, :3]) + 0.5


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_flow_ids_and_occlusion_are_those_of_opencv_projections(camera, ground):
    poses, centers = PATH.poses(), camera.pixel_centers()
    truth = renderer_of(camera, ground, BOARD).truth(poses, 0)
    is_ground, is_board = truth.object_id == 1, truth.object_id == 2
    assert is_ground.sum() > 1000
    assert is_board.sum() > 100
    assert np.abs(truth.position[is_ground][:, 2]).max() < 1e-6
    seen = (is_ground | is_board) & np.isfinite(truth.flow_forward).all(axis=-1)
    points = truth.position[seen]
    # Flow and the points are exact; positions on triangles are stored in float32 of some meters.
    found = seen_by_opencv(camera, points, poses[0])
    np.testing.assert_allclose(found, centers[seen], rtol=0, atol=1e-4)
    moved = seen_by_opencv(camera, points, poses[1])
    expected = centers[seen] + truth.flow_forward[seen]
    np.testing.assert_allclose(moved, expected, rtol=0, atol=1e-4)
    # The ground is hidden in the next frame where a line to its eye crosses the board.
    eye, hit = poses[1][:3, 3], truth.position[is_ground]
    edges = BOARD.vertices
    normal = np.cross(edges[1] - edges[0], edges[3] - edges[0])
    share = ((edges[0] - eye) @ normal) / ((hit - eye) @ normal)
    across = eye + share[:, None] * (hit - eye)
    inside = (np.abs(across[:, 1] - 0.05) < 0.65) & (np.abs(across[:, 2] - 0.95) < 0.65)
    hidden = inside & (share > 0) & (share < 1)
    assert hidden.sum() > 20
    np.testing.assert_array_equal(truth.occluded_forward[is_ground], hidden)
    if camera.fisheye:
        depth = np.linalg.norm(points - poses[0][:3, 3], axis=-1)
    else:
        depth = (points - poses[0][:3, 3]) @ poses[0][:3, 2]
    np.testing.assert_allclose(truth.depth[seen], depth, rtol=1e-6)
