"""Camera motion by one likelihood, on views that are known exactly."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from megalopta.flow.camera_motion import (
    camera_motion_with_error,
    likely_camera_motion,
    motion_of_flow,
)
from megalopta.scenes import EquirectangularCamera, PerspectiveCamera

from .corner import CORNER, beside_a_trunk, flight

CAMERA = PerspectiveCamera(width=96, height=80, fov_deg=60)


def counts(light, photons, seed=0):
    return np.random.default_rng(seed).poisson(photons * light).astype(np.uint16)


def angle_deg(first, second):
    return np.degrees(np.arccos(np.clip(first @ second / np.linalg.norm(second), -1, 1)))


@pytest.mark.parametrize(
    ("turn_deg", "step_m", "change_deg"),
    [
        ((0.1, 0.5, 0), (0.06, 0, 0.02), (0, 0, 0)),
        ((0, -0.4, 0.2), (-0.03, -0.01, 0.05), (0, 0, 0)),
        # told at the middle; as steady turns, changes move the outermost frames by 0.7° and 0.2°
        ((0, 0.5, 0), (0.05, 0.0, 0.03), (0.02, 0.06, 0)),
    ],
)
def test_bright_views_tell_rotation_and_heading(turn_deg, step_m, change_deg):
    light = flight(CAMERA, turn_deg, step_m, change_deg=change_deg)
    found = likely_camera_motion(counts(light, 1000), CAMERA)
    # A pixel sees 0.6°. Where the floor meets the wall, distances at nodes 4 px apart are too smooth.
    np.testing.assert_allclose(found.rotation_deg, turn_deg, atol=0.02)
    assert angle_deg(found.heading, np.array(step_m)) < 3


def test_frames_all_around_tell_the_heading():
    camera = EquirectangularCamera(width=128, height=64, fov_deg=360)
    step_m = (0.04, 0, 0.03)
    found = likely_camera_motion(counts(flight(camera, (0, 0, 0), step_m), 1000), camera)
    assert angle_deg(found.heading, np.array(step_m)) < 5
    assert np.linalg.norm(found.rotation_deg) < 0.1


def test_a_turn_across_the_seam_of_a_panorama():
    """Nodes of sides that 4 does not divide lie at the edge; none may see across the seam."""
    height, width = 49, 97
    camera = EquirectangularCamera(width=width, height=height, fov_deg=360)
    y, x = np.mgrid[:height, :width]
    turn = np.radians(1.7)
    east = 2 * np.pi * x / width + turn * np.arange(8)[:, np.newaxis, np.newaxis]
    light = (2 + np.sin(9 * east) + np.sin(y / 3 + 5 * east)).clip(0)
    found = likely_camera_motion(counts(light, 50), camera)
    np.testing.assert_allclose(found.rotation_deg, (0, 1.7, 0), atol=0.02)


@pytest.mark.slow
def test_beside_a_trunk_at_rest_the_stated_error_is_not_what_the_view_is_without_it():
    """Without the trunk, which tells most, the heading changes by 10° and more."""
    turn_deg, step_m = (0.25, -0.7, -0.14), (0.065, 0.006, -0.025)
    camera = PerspectiveCamera(width=48, height=40, fov_deg=60)
    light = flight(camera, turn_deg, step_m, planes=(CORNER[0], ((0.49, 0.0, 1.0), 5.8)))
    drawn = counts(beside_a_trunk(camera, light, turn_deg, step_m, 0.0), 100)
    motion, error = camera_motion_with_error(drawn, camera)
    assert angle_deg(motion.heading, np.array(step_m)) < 2 * error.heading_deg < 15
    assert (np.abs(motion.rotation_deg - turn_deg) < 2 * error.rotation_deg).all()
    assert (error.rotation_deg < 0.5).all()


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        (np.ones((8, 80, 90), np.uint16), "80 × 96 px"),
        (np.ones((1, 80, 96), np.uint16), "two or more frames"),
        (np.zeros((8, 80, 96), np.uint16), "have no contrast"),
        (np.arange(-2.0, 6).repeat(80 * 96).reshape(8, 80, 96), "0 or more"),
    ],
)
def test_what_tells_nothing_is_refused(frames, message):
    with pytest.raises(ValueError, match=message):
        likely_camera_motion(frames, CAMERA)


def seen(rng, turn_deg, step_m, count=300):
    """Points at 2 to 20 m before a camera that moves, as it sees them before and after."""
    directions = rng.normal(size=(count, 3))
    directions[:, 2] = np.abs(directions[:, 2]) + 0.5
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    way, turn = (each / np.linalg.norm(each) for each in rng.normal(size=(2, 3)))
    way, turn = step_m * way, turn_deg * turn
    points = directions * rng.uniform(2, 20, (count, 1)) - way
    moved = Rotation.from_rotvec(turn, degrees=True).inv().apply(points)
    moved /= np.linalg.norm(moved, axis=1, keepdims=True)
    return directions, moved, turn, way / step_m


@pytest.mark.parametrize("seed", range(3))
def test_motion_without_noise_is_found_exactly(seed):
    directions, moved, turn, way = seen(np.random.default_rng(seed), turn_deg=3, step_m=0.2)
    camera = SimpleNamespace(toward=np.copy)  # whose image coordinates are directions
    found = motion_of_flow(camera, directions, moved - directions)
    assert angle_deg(found.heading, way) < 1e-4
    np.testing.assert_allclose(found.rotation_deg, turn, atol=1e-6)
