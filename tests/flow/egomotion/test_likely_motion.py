"""Camera motion by one likelihood, on views that are known exactly."""

import numpy as np
import pytest

from megalopta.flow.camera_motion import camera_motion_with_error, likely_camera_motion
from megalopta.scenes import EquirectangularCamera, PerspectiveCamera

from .corner import CORNER, beside_a_trunk, flight

CAMERA = PerspectiveCamera(width=96, height=80, fov_deg=60)


FARTHER = ((0.4, 0.0, 1.0), 7.1)
"""The wall ahead, farther than in the corner"""


def counts(light, photons, seed=0):
    return np.random.default_rng(seed).poisson(photons * light).astype(np.uint16)


def angle_deg(first, second):
    return np.degrees(np.arccos(np.clip(first @ second / np.linalg.norm(second), -1, 1)))


@pytest.mark.parametrize(
    ("turn_deg", "step_m"),
    [((0.1, 0.5, 0), (0.06, 0, 0.02)), ((0, -0.4, 0.2), (-0.03, -0.01, 0.05))],
)
def test_bright_views_tell_rotation_and_heading(turn_deg, step_m):
    found = likely_camera_motion(counts(flight(CAMERA, turn_deg, step_m), 1000), CAMERA)
    # A pixel sees 0.6°. Where the floor meets the wall, distances at nodes 4 px apart are too smooth.
    np.testing.assert_allclose(found.rotation_deg, turn_deg, atol=0.02)
    assert angle_deg(found.heading, np.array(step_m)) < 3


@pytest.mark.slow
def test_eight_dim_frames_tell_what_two_do_not():
    turn_deg, step_m = (0, 0.6, 0), (0.05, 0.0, 0.03)
    light = flight(CAMERA, turn_deg, step_m)
    errors = np.empty((2, 3))
    for index, some in enumerate((light[3:5], light)):
        for seed in range(3):
            found = likely_camera_motion(counts(some, 30, seed), CAMERA)
            errors[index, seed] = np.abs(found.rotation_deg[1] - 0.6)
    # Their variance is 84 times as small in theory, 2/J and 1/(42·J).
    assert np.median(errors[1]) < 0.1
    assert np.median(errors[0]) > 2 * np.median(errors[1])


def test_a_turn_that_changes_is_told_at_the_middle():
    step_m = (0.05, 0.0, 0.03)
    light = flight(CAMERA, (0, 0.5, 0), step_m, change_deg=(0.02, 0.06, 0))
    found = likely_camera_motion(counts(light, 1000), CAMERA)
    # As steady turns: the changes move the outermost frames by 0.7° and 0.2°.
    np.testing.assert_allclose(found.rotation_deg, (0, 0.5, 0), atol=0.02)
    assert angle_deg(found.heading, np.array(step_m)) < 3


def test_frames_all_around_tell_the_heading():
    camera = EquirectangularCamera(width=160, height=80, fov_deg=360)
    step_m = (0.04, 0, 0.03)
    found = likely_camera_motion(counts(flight(camera, (0, 0, 0), step_m), 1000), camera)
    assert angle_deg(found.heading, np.array(step_m)) < 5
    assert np.linalg.norm(found.rotation_deg) < 0.1


@pytest.mark.parametrize("shape", [(49, 97), (48, 96)])
def test_a_turn_across_the_seam_of_a_panorama(shape):
    """Nodes of sides that 4 does not divide lie at the edge; none may see across the seam."""
    height, width = shape
    camera = EquirectangularCamera(width=width, height=height, fov_deg=360)
    y, x = np.mgrid[:height, :width]
    turn = np.radians(1.7)
    east = 2 * np.pi * x / width + turn * np.arange(8)[:, np.newaxis, np.newaxis]
    light = (2 + np.sin(9 * east) + np.sin(y / 3 + 5 * east)).clip(0)
    found = likely_camera_motion(counts(light, 50), camera)
    np.testing.assert_allclose(found.rotation_deg, (0, 1.7, 0), atol=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("sideways_m", [0.0, 0.07])
def test_a_trunk_that_moves_is_within_the_stated_error(sideways_m):
    """At rest it is half of what tells the motion; moving, it misleads by 0.3° and 20°."""
    turn_deg, step_m = (0, 0.4, 0), (0.03, 0.0, 0.05)
    light = beside_a_trunk(CAMERA, flight(CAMERA, turn_deg, step_m), turn_deg, step_m, sideways_m)
    drawn = counts(light, 30)
    motion, error = camera_motion_with_error(drawn, CAMERA)
    np.testing.assert_array_equal(motion.heading, likely_camera_motion(drawn, CAMERA).heading)
    off_deg = np.abs(motion.rotation_deg - turn_deg)
    heading_deg = angle_deg(motion.heading, np.array(step_m))
    assert (off_deg < 3 * error.rotation_deg).all() and heading_deg < 3 * error.heading_deg
    is_misled = max(off_deg) > 0.2 or heading_deg > 10
    assert is_misled == bool(sideways_m)


def test_a_trunk_that_crosses_every_strip_is_within_the_stated_error():
    """From estimates without strips alone, a heading 120° off is stated to 10°."""
    turn_deg, step_m = (0.5, 0.5, -0.6), (-0.05, 0.0, -0.03)
    camera, walls = PerspectiveCamera(width=48, height=40, fov_deg=60), (CORNER[0], FARTHER)
    light = flight(camera, turn_deg, step_m, planes=walls)
    drawn = counts(beside_a_trunk(camera, light, turn_deg, step_m, -0.09), 100)
    motion, error = camera_motion_with_error(drawn, camera)
    assert 60 < angle_deg(motion.heading, np.array(step_m)) < 3 * error.heading_deg
    assert (np.abs(motion.rotation_deg - turn_deg) < 3 * error.rotation_deg).all()


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        (np.ones((8, 80, 90), np.uint16), "80 × 96 px"),
        (np.ones((1, 80, 96), np.uint16), "two or more frames"),
        (np.zeros((8, 80, 96), np.uint16), "have no contrast"),
        (np.eye(80, 96, dtype=np.uint16) * np.arange(8)[:, None, None], "one of them, have no"),
        (np.full((8, 80, 96), np.nan), "0 or more"),
        (np.arange(-2.0, 6).repeat(80 * 96).reshape(8, 80, 96), "0 or more"),
    ],
)
def test_what_tells_nothing_is_refused(frames, message):
    with pytest.raises(ValueError, match=message):
        likely_camera_motion(frames, CAMERA)
