"""Where cameras go, and what their paths have in common."""

import itertools

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation, Slerp

from megalopta.scenes import (
    EquirectangularCamera,
    Hover,
    Orbit,
    PerspectiveCamera,
    Recorded,
    Trajectory,
)
from megalopta.scenes.trajectories.orbit import Fit

RNG = np.random.default_rng(5)
KNOTS = np.array([3.0, 3.4, 4.1, 5.0, 5.2, 6.5])
PLACES = RNG.normal(size=(6, 3))
TURNS = Rotation.from_rotvec(RNG.normal(scale=0.7, size=(6, 3)))


def recording(knots=KNOTS, places=PLACES, turns=TURNS):
    rows = np.column_stack([knots, places, turns.as_quat()])
    return "t,x,y,z,qx,qy,qz,qw\n" + "\n".join(",".join(map(repr, row)) for row in rows.tolist())


PATHS = {
    "steady": Trajectory(rotation_deg_s=20, velocity_m_s=(1, 2, 0.5)),
    "orbit": Orbit(height_m=2.0, rate_deg_s=-40),
    "recorded": Recorded(csv=recording(), frames=30),
    "hover": Hover(seed=2),
}


@pytest.mark.parametrize("path", PATHS.values(), ids=PATHS.keys())
def test_poses_are_rigid_and_right_handed_and_float32_about_the_local_origin(path):
    rotations = path.poses()[:, :3, :3]
    products = rotations @ rotations.swapaxes(1, 2)
    np.testing.assert_allclose(products - np.eye(3), 0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(rotations), 1, atol=1e-12)
    offsets = path.poses()[:, :3, 3] - path.origin_m
    assert np.abs(offsets).max() < 10
    np.testing.assert_array_equal(offsets, offsets.astype(np.float32))


@pytest.mark.parametrize("path", PATHS.values(), ids=PATHS.keys())
def test_a_pose_between_frames_is_the_pose_of_that_time(path):
    # The same path at ten times the frame rate has the frames' poses and those between.
    fine = path.model_copy(update={"frames": 10 * (path.frames - 1) + 1, "frame_rate_hz": 100.0})
    if isinstance(path, Recorded):
        fine = fine.model_copy(update={"frames": path.frames, "frame_rate_hz": 10.0})
    np.testing.assert_allclose(fine.pose_at(path.times_s), path.poses(), atol=1e-6)
    between = path.pose_at([0.25, 0.35])
    np.testing.assert_allclose(between, fine.pose_at([0.25, 0.35]), atol=1e-6)


def test_an_orbit_keeps_its_radius_and_its_point_in_the_image_center():
    path = Orbit(center_m=(3, 4, 1), radius_m=6, height_m=2.5, rate_deg_s=30, frames=11)
    position, forward = path.poses()[:, :3, 3], path.poses()[:, :3, 2]
    np.testing.assert_allclose(np.hypot(*(position[:, :2] - [3, 4]).T), 6, atol=1e-6)
    np.testing.assert_allclose(position[:, 2], 3.5, atol=1e-6)
    distance = np.hypot(6, 2.5)
    np.testing.assert_allclose(
        position + distance * forward, np.tile([3, 4, 1], (11, 1)), atol=1e-5
    )
    # A second at 30°/s, counterclockwise from 180°.
    np.testing.assert_allclose(position[-1, :2], [3 - 6 * np.cos(np.pi / 6), 4 - 3], atol=1e-6)


def test_a_recording_is_slerp_between_its_orientations_and_passes_its_positions():
    path = Recorded(csv=recording(), frames=2)
    times = np.linspace(0, 3.5, 41)
    expected = Slerp(KNOTS, TURNS)(times + 3.0).as_matrix()
    np.testing.assert_allclose(path.pose_at(times)[:, :3, :3], expected, atol=1e-12)
    np.testing.assert_allclose(path.pose_at(KNOTS - 3)[:, :3, 3], PLACES, atol=1e-6)


def test_a_recording_is_read_from_its_file_and_kept_in_the_configuration(tmp_path):
    file = tmp_path / "path.csv"
    file.write_text(recording())
    path = Recorded(csv=str(file), frames=10)
    file.unlink()
    again = Recorded.model_validate(path.model_dump(mode="json"))
    assert again == path
    np.testing.assert_array_equal(again.poses(), path.poses())


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("0,0,0,0,0,0,0\n1,0,0,0,0,0,0,1", "line 1 is not the 8 numbers t,x"),
        ("t,x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n1,0,0,nan,0,0,0,1", "line 3 is not the 8"),
        ("0,0,0,0,0,0,0,1\n0,0,0,0,0,0,0,1", "line 2: t 0 s does not increase"),
        ("0,0,0,0,0,0,0,1\n1,0,0,0,0,0,1,1", r"line 2: the quaternion .* has norm 1\.41"),
        ("0,0,0,0,0,0,0,1\n", "1 poses; a path needs at least 2"),
        ("\n", "0 poses"),
    ],
)  # fmt: skip
def test_a_broken_recording_is_refused_with_its_line(text, words, tmp_path):
    file = tmp_path / "path.csv"
    file.write_text(text)
    with pytest.raises(ValidationError, match=rf"path\.csv: {words}"):
        Recorded(csv=str(file), frames=2)


def test_hover_has_its_amplitude_and_nothing_beyond_its_bandwidth():
    path = Hover(position_m=(0, 0, 2), look_at_m=(5, 0, 2), jitter_m=0.04, jitter_deg=0.5,
                 bandwidth_hz=3.0, frames=4096, frame_rate_hz=20)  # fmt: skip
    poses = path.poses()
    offset = poses[:, :3, 3] - [0, 0, 2]
    # 600 periods of the band: the cross terms of 48 waves leave a few percent.
    np.testing.assert_allclose(np.sqrt((offset**2).mean(axis=0)), 0.04, rtol=0.1)
    middle = Rotation.from_matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    angles = (middle.inv() * Rotation.from_matrix(poses[:, :3, :3])).as_rotvec(degrees=True)
    np.testing.assert_allclose(np.sqrt((angles**2).mean(axis=0)), 0.5, rtol=0.1)
    window = np.hanning(len(offset))[:, None]
    power = np.abs(np.fft.rfft(offset * window, axis=0)) ** 2
    frequency = np.fft.rfftfreq(len(offset), 1 / 20)
    assert power[frequency > 3.05].sum() < 1e-6 * power.sum()


def test_a_steady_camera_looks_at_its_target_turns_left_and_moves_along_a_line():
    path = Trajectory(
        position_m=(1, 2, 3), look_at_m=(4, 6, 3), rotation_deg_s=90, velocity_m_s=(0.1, 0.2, 0.3),
        frames=11,
    )  # fmt: skip
    first, *_, last = path.poses()
    axes = [[0.8, -0.6, 0], [0, 0, -1], [0.6, 0.8, 0]]  # right, down and forward
    np.testing.assert_allclose(first[:3, :3].T, axes, atol=1e-12)
    np.testing.assert_allclose(last[:3, 2], [-0.8, 0.6, 0], atol=1e-12)
    np.testing.assert_allclose(last[:3, 3], [1.1, 2.2, 3.3], rtol=1e-7)


@pytest.mark.parametrize("up", [(0, 0, 1), (0, 0, -2), (0, 0, 0)])
def test_up_parallel_to_the_view_is_refused(up):
    with pytest.raises(ValueError, match=r"up .* is parallel to the view"):
        Trajectory(position_m=(0, 0, 0), look_at_m=(0, 0, 5), up=up)
    with pytest.raises(ValueError, match="equals position_m"):
        Trajectory(position_m=(1, 1, 1), look_at_m=(1, 1, 1))


@pytest.mark.parametrize(
    "camera",
    [
        PerspectiveCamera(width=64, height=48, fov_deg=60),
        PerspectiveCamera(width=40, height=200, fov_deg=1),
        EquirectangularCamera(width=128, height=64),
    ],
)
@pytest.mark.parametrize(
    "bounds", [[[-1, -1, -1], [1, 1, 1]], [[1e3, 5, 0], [1.01e3, 5.001, 0.02]]]
)
def test_a_fitted_camera_sees_all_of_a_box_and_is_not_too_far(camera, bounds):
    bounds = np.array(bounds, float)
    path = Fit(frames=40, rate_deg_s=90, elevation_deg=30).around(bounds, camera)
    corners = np.array(list(itertools.product(*bounds.T)))
    spans = []
    for pose in path.poses():
        image = camera.project((corners - pose[:3, 3]) @ pose[:3, :3])
        assert ((image > 0) & (image < [camera.width, camera.height])).all()
        spans.append((np.ptp(image, axis=0) / [camera.width, camera.height]).max())
    assert max(spans) > 0.4
