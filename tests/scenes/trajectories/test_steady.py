import numpy as np
import pytest

from megalopta.scenes.trajectories.steady import Trajectory


def test_first_frame_looks_at_the_target_with_the_horizon_level():
    pose = Trajectory(position_m=(1, 2, 3), look_at_m=(4, 6, 3)).poses()[0]
    right, down, forward = pose[:3, :3].T
    np.testing.assert_allclose(forward, [0.6, 0.8, 0], atol=1e-12)
    np.testing.assert_allclose(down, [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(right, [0.8, -0.6, 0], atol=1e-12)


def test_positive_rotation_turns_left():
    trajectory = Trajectory(frames=11, frame_rate_hz=10, look_at_m=(1, 0, 1.5), rotation_deg_s=90)
    np.testing.assert_allclose(trajectory.poses()[-1][:3, 2], [0, 1, 0], atol=1e-12)


def test_translation_follows_a_line():
    poses = Trajectory(frames=5, frame_rate_hz=2, velocity_m_s=(0.1, 0.2, 0.3)).poses()
    np.testing.assert_allclose(poses[-1, :3, 3], [0.2, 0.4, 2.1], rtol=1e-7)


@pytest.mark.parametrize("up", [(0, 0, 1), (0, 0, -2), (0, 0, 0)])
def test_up_parallel_to_the_view_is_refused(up):
    with pytest.raises(ValueError, match=r"up .* is parallel to the view"):
        Trajectory(position_m=(0, 0, 0), look_at_m=(0, 0, 5), up=up)
    with pytest.raises(ValueError, match="equals position_m"):
        Trajectory(position_m=(1, 1, 1), look_at_m=(1, 1, 1))
