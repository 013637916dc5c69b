import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from megalopta.flow.egomotion.heading import camera_motion


def seen(rng, turn_deg, step_m, noise_rad=0.0, wrong=0.0, count=300):
    """Points at 2 to 20 m before a camera that moves, as it sees them before and after."""
    directions = rng.normal(size=(count, 3))
    directions[:, 2] = np.abs(directions[:, 2]) + 0.5
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    way, turn = (each / np.linalg.norm(each) for each in rng.normal(size=(2, 3)))
    way, turn = step_m * way, turn_deg * turn
    points = directions * rng.uniform(2, 20, (count, 1)) - way
    moved = Rotation.from_rotvec(turn, degrees=True).inv().apply(points)
    moved /= np.linalg.norm(moved, axis=1, keepdims=True)
    moved += noise_rad * rng.normal(size=moved.shape)
    outlier = rng.random(count) < wrong
    moved[outlier] += 0.05 * rng.normal(size=(outlier.sum(), 3))
    return directions, moved / np.linalg.norm(moved, axis=1, keepdims=True), turn, way / step_m


def angle_deg(first, second):
    return np.degrees(np.arccos(np.clip(first @ second, -1, 1)))


@pytest.mark.parametrize("seed", range(5))
def test_motion_without_noise_is_found_exactly(seed):
    directions, moved, turn, way = seen(np.random.default_rng(seed), turn_deg=3, step_m=0.2)
    found = camera_motion(directions, moved)
    assert angle_deg(found.heading, way) < 1e-4
    np.testing.assert_allclose(found.rotation_deg, turn, atol=1e-6)


def test_undefined_velocities_are_left_out():
    directions, moved, _, way = seen(np.random.default_rng(0), 3, 0.2)
    moved[::3] = np.nan
    assert angle_deg(camera_motion(directions, moved).heading, way) < 1e-4


def test_too_few_velocities_are_refused():
    directions, moved, _, _ = seen(np.random.default_rng(0), 3, 0.2, count=7)
    with pytest.raises(ValueError, match="7 velocities are defined"):
        camera_motion(directions, moved)
