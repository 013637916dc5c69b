"""What whole pixels see: exact at straight outlines, within the rays' error in a forest."""

import numpy as np
import pytest
import trimesh

from megalopta.scenes import PerspectiveCamera, Trajectory
from megalopta.scenes.motion import Drift, RigidMotion

from ..conftest import GRAY, quad, renderer_of

CAMERA = PerspectiveCamera(width=40, height=30, fov_deg=60)
SLIDE = Trajectory(
    frames=3,
    frame_rate_hz=1,
    position_m=(0, 0, 0),
    look_at_m=(1, 0, 0),
    velocity_m_s=(0.0, 0.31, 0.12),
)
WALL = quad(np.array([[10, -99, -99], [10, 99, -99], [10, 99, 99], [10, -99, 99.0]]))


def below_line(height, slope):
    """Area (H, W) of each pixel below the line y = height + slope · x, y downward, in px."""

    def integral(t):
        inside = np.clip(t, 0, 1)
        return inside**2 / 2 + np.maximum(t - 1, 0)

    x, y = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    # Above the line, as the part of a column of the pixel between its top and the line.
    start = height + slope * x - y
    return np.clip(1 - (integral(start + slope) - integral(start)) / slope, 0, 1)


def edge_of(height, slope):
    """A sheet at x = 5 that fills the image below that line, as the camera at the origin sees it."""
    focal = CAMERA.focal_length_px

    def at(column, row):
        return [5, -(column - CAMERA.width / 2) * 5 / focal, -(row - CAMERA.height / 2) * 5 / focal]

    left, right, lower = -50.0, CAMERA.width + 50.0, 4000.0
    upper = at(left, height + slope * left), at(right, height + slope * right)
    return quad(np.array([*upper, at(right, lower), at(left, lower)]))


@pytest.mark.parametrize("rays", [16, 64])
@pytest.mark.parametrize(("height", "slope"), [(14.3, 0.07), (3.21, 0.61), (29.0, -0.83)])
def test_purity_mean_flow_and_spread_are_exact_at_an_edge(rays, height, slope):
    renderer = renderer_of(CAMERA, WALL, edge_of(height, slope), truth_rays=rays)
    truth = renderer.truth(SLIDE.poses(), 0)
    found, share = truth.footprint, below_line(height, slope)
    assert ((share > 0) & (share < 0.05)).any()
    own = np.where(truth.object_id == 2, share, 1 - share)
    # Corners of the sheet, thousands of pixels away, are stored in float32.
    np.testing.assert_allclose(found.purity, own, atol=1e-5)
    assert found.is_mixed[(share > 1e-5) & (share < 1 - 1e-5)].all()
    assert not found.is_mixed[(share == 0) | (share == 1)].any()
    # To the image's left and down, by 5 m and by 10 m.
    near, far = (CAMERA.focal_length_px * np.array([0.31, 0.12]) / depth for depth in (5.0, 10.0))
    mean = share[..., None] * near + (1 - share[..., None]) * far
    np.testing.assert_allclose(found.forward.mean, mean, atol=2e-5)
    spread = np.sqrt(share * (1 - share)) * np.linalg.norm(near - far)
    np.testing.assert_allclose(found.forward.spread, spread, atol=2e-5)
    assert not found.sky.any()


def test_a_thin_branch_within_a_pixel_has_its_exact_share():
    # A strip 0.3 px wide that leans: no ray has to lie in it for more than its share.
    focal = CAMERA.focal_length_px
    strip = np.array([[5, -0.15, -9], [5, 0.15, -9], [5, 0.15, 9], [5, -0.15, 9]])
    strip[:, 1] = strip[:, 1] * 2 * 5 / focal + strip[:, 2] * 0.11
    truth = renderer_of(CAMERA, WALL, quad(strip)).truth(SLIDE.poses(), 0)
    found = truth.footprint
    branch = np.where(truth.object_id == 2, found.purity, 1 - found.purity)
    np.testing.assert_allclose(branch.sum(axis=1), 0.6, atol=0.08)
    assert branch.sum() == pytest.approx(0.6 * CAMERA.height, rel=0.02)


def test_sky_and_edges_to_the_sky(ground):
    level = Trajectory(frames=2, position_m=(0, 0, 2.0), look_at_m=(1, 0, 2.037))
    truth = renderer_of(CAMERA, ground).truth(level.poses(), 0)
    found = truth.footprint
    horizon = CAMERA.height / 2 + 0.037 * CAMERA.focal_length_px  # less 2 m in a kilometer
    row = int(horizon)
    assert (found.sky[:row] == 1).all()
    assert (found.sky[row + 1 :] == 0).all()
    np.testing.assert_allclose(found.sky[row], horizon - row, atol=0.07)
    assert (found.is_mixed == ((found.sky > 0) & (found.sky < 1))).all()
    # The sky does not move: its flow is that of a camera that stands still.
    np.testing.assert_allclose(found.forward.mean[found.sky == 1], 0, atol=1e-5)


def test_part_of_a_pixel_is_hidden_behind_an_edge():
    # A sheet from y = -0.4 on, upright: what it hides next is a strip of the wall.
    sheet = quad(np.array([[5, -9, -99], [5, -0.4, -99], [5, -0.4, 99], [5, -9, 99.0]]))
    aside = SLIDE.model_copy(update={"velocity_m_s": (0.0, -0.31, 0.0)})
    truth = renderer_of(CAMERA, WALL, sheet).truth(aside.poses(), 0)
    hidden = truth.footprint.forward.hidden
    focal, center = CAMERA.focal_length_px, CAMERA.width / 2
    # Seen from 0.31 m farther right the edge stands before y = -0.49 of the wall, now -0.8.
    left, right = (center - focal * y / 10 for y in (2 * -0.4 + 0.31, -0.8))
    columns = np.arange(CAMERA.width)
    share = np.clip(np.minimum(columns + 1, right) - np.maximum(columns, left), 0, 1)
    np.testing.assert_allclose(hidden, np.broadcast_to(share, hidden.shape), atol=1 / 16)
    partly = (hidden > 0) & (hidden < 1)
    assert partly.any(axis=0).sum() <= 2
    assert partly.any()


@pytest.mark.parametrize("is_moving", [False, True], ids=["camera", "leaf"])
def test_no_point_is_visible_through_its_own_leaf(is_moving):
    leaf = trimesh.Trimesh(
        [[5, -2, -1], [5, 2, -1], [5, 0.5, 2], [5.3, -0.5, 2]],
        [[0, 1, 2], [0, 2, 3]],
        process=False,
    )
    poses = np.stack([SLIDE.poses()[0]] * 3)
    if is_moving:
        # Half a turn in the frame that follows, and back.
        motion = RigidMotion((5.0, 0.0, 0.0), Drift(spin_deg_s=180, spin_axis=(0, 0, 1)))
        renderer = renderer_of(CAMERA, (leaf, GRAY, motion))
    else:
        poses[1, :2, :3] *= -1  # half a turn about the vertical
        poses[1, :3, 3] = 10, 0, 0
        renderer = renderer_of(CAMERA, leaf)
    truth = renderer.truth(poses, 0, [0.0, 1.0, 2.0])
    on_leaf = truth.object_id == 1
    assert on_leaf.sum() > 50
    assert truth.occluded_forward[on_leaf].all()
    if not is_moving:
        assert not truth.occluded_forward[~on_leaf].any()
    whole = on_leaf & ~truth.footprint.is_mixed
    assert (truth.footprint.forward.hidden[whole] == 1).all()
    there_and_back = renderer.flow(poses, 0, 2, [0.0, 1.0, 2.0])
    assert not there_and_back.occluded.any()
