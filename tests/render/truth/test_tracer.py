"""Flow, depth and occlusion against geometry worked out here in float64, without the renderer."""

import numpy as np
import pytest
import trimesh

from megalopta.render import out_of_view
from megalopta.scenes import PerspectiveCamera, Trajectory

from ..conftest import quad, renderer_of
from .oracle import BOTH, Pinhole, plane_hit

CAMERA = PerspectiveCamera(width=96, height=72, fov_deg=70)
TURNING = BOTH.model_copy(update={"velocity_m_s": (0.0, 0.0, 0.0)})
MOVING = BOTH.model_copy(update={"rotation_deg_s": 0.0})


@pytest.mark.parametrize("trajectory", [BOTH, TURNING, MOVING], ids=["both", "turn", "move"])
def test_flow_over_a_plane_is_analytic_within_1e_4_px(trajectory, ground):
    truth = renderer_of(CAMERA, ground).truth(trajectory.poses(), 1)
    seen = truth.object_id == 1
    assert seen.mean() > 0.5
    for flow, other in ((truth.flow_forward, 2), (truth.flow_backward, 0)):
        error = flow - Pinhole(CAMERA, trajectory).flow(1, other, plane_hit)
        assert np.abs(error[seen]).max() < 1e-4


def test_sky_moves_by_rotation_alone():
    truth = renderer_of(CAMERA, quad(np.array([[0, 0, -9], [1, 0, -9], [1, 1, -9], [0, 1, -9.0]])))
    flow = truth.truth(BOTH.poses(), 1).flow_forward
    far = Pinhole(CAMERA, TURNING).flow(1, 2, lambda _, rays: np.ones(rays.shape[:2]))
    # The reference turns about a camera that stays; both are exact, float32 storage remains.
    np.testing.assert_allclose(flow, far, atol=1e-5)


def test_normals_are_geometric_and_face_the_camera():
    box = trimesh.creation.box((1, 1, 1))
    box.invert()  # normals inward: the truth must turn them round
    box.apply_translation([6, 1, 1])
    truth = renderer_of(CAMERA, box).truth(BOTH.poses(), 0)
    seen = truth.object_id == 1
    _, directions = Pinhole(CAMERA, BOTH).rays(0)
    normals = truth.normal[seen]
    assert ((normals * directions[seen]).sum(-1) < 0).all()
    assert set(map(tuple, np.abs(normals).round(6))) <= {(1, 0, 0), (0, 1, 0), (0, 0, 1)}
    assert np.isnan(truth.normal[~seen]).all() and np.isinf(truth.depth[~seen]).all()


def test_occlusion_is_exact_behind_a_rectangle():
    # A wall x = 10 behind a rectangle x = 5; the camera slides sideways along +y.
    slide = Trajectory(
        frames=2,
        frame_rate_hz=1,
        position_m=(0, 0, 0),
        look_at_m=(1, 0, 0),
        velocity_m_s=(0.0, 0.83, 0.11),
    )
    wall = quad(np.array([[10, -99, -99], [10, 99, -99], [10, 99, 99], [10, -99, 99.0]]))
    low, high = np.array([-1.013, -0.721]), np.array([1.117, 0.857])
    rectangle = quad(
        np.array([[5, low[0], low[1]], [5, high[0], low[1]], [5, *high], [5, low[0], high[1]]])
    )
    truth = renderer_of(CAMERA, wall, rectangle).truth(slide.poses(), 0)
    origin, directions = Pinhole(CAMERA, slide).rays(0)
    on_wall = truth.object_id == 1
    points = origin + 10 * directions / directions[..., :1]
    other = origin + np.asarray(slide.velocity_m_s)
    crossing = other + (points - other) * ((5 - other[0]) / (points - other)[..., :1])
    hidden = ((crossing[..., 1:] > low) & (crossing[..., 1:] < high)).all(axis=-1)
    assert (hidden & on_wall).sum() > 100
    assert (truth.occluded_forward[on_wall] == hidden[on_wall]).all()
    assert not truth.occluded_forward[~on_wall].any()


def test_points_behind_the_other_camera_have_no_flow(ground):
    leap = Trajectory(
        frames=2,
        frame_rate_hz=1,
        position_m=(0, 0, 2),
        look_at_m=(5, 0, 0),
        velocity_m_s=(8.0, 0, 0),
    )
    truth = renderer_of(CAMERA, ground).truth(leap.poses(), 0)
    assert np.isnan(truth.flow_forward[-1]).all()
    assert out_of_view(truth.flow_forward)[-1].all()
