""""""

import numpy as np
import pytest

from megalopta.render import RenderSettings, SceneRenderer
from megalopta.scenes import Light, PerspectiveCamera, Plane, Trajectory
from megalopta.scenes.spectra.spectrum import flat, luminous

CAMERA = PerspectiveCamera(width=64, height=16, fov_deg=40)
SLIDING = Trajectory(frames=4, velocity_m_s=(0, -0.3, 0))
SETTINGS = RenderSettings(samples_per_pixel=256, max_depth=2, bands_nm=((500, 600),))
LUX = 2.0
LIGHT = Light(illuminance_lux=LUX)


def row(plane, trajectory=SLIDING, frame=0):
    """Middle row of a rendered frame, 1 where the luminance is the mean."""
    scene = plane.build(LIGHT, CAMERA, trajectory)
    renderer = SceneRenderer(scene, CAMERA, SETTINGS)
    radiance = renderer.radiance(trajectory.poses()[frame], 1)[8, :, 0]
    return radiance / (LUX / np.pi / luminous(flat(1.0)))


def places_m(plane):
    """Where on the board the columns look, right of the middle (m)."""
    return (np.arange(64) + 0.5 - 32) * plane.distance_m / CAMERA.focal_length_px


def test_bars_have_the_luminance_profile_that_was_asked_for():
    plane = Plane(pattern="sine", contrast=0.6, period_m=0.4, phase_rad=0.3)
    pixel = plane.distance_m / CAMERA.focal_length_px
    blur = np.sinc(pixel / plane.period_m)  # a pixel is a box on the board
    expected = 1 + 0.6 * blur * np.sin(2 * np.pi * places_m(plane) / plane.period_m + 0.3)
    # 256 stratified samples within a pixel of slope at most 1.8 per pixel: below 1 %
    np.testing.assert_allclose(row(plane), expected, atol=0.01)


def test_a_sliding_camera_sees_the_board_shift_by_focal_length_times_way_over_distance():
    plane = Plane(pattern="sine", contrast=1.0, period_m=0.5)
    # the camera looks along +x with y to its left: −y is a way to the right
    shifted = Plane(pattern="sine", contrast=1.0, period_m=0.5, phase_rad=2 * np.pi * 0.06 / 0.5)
    np.testing.assert_allclose(row(plane, frame=2), row(shifted), atol=0.01)


@pytest.mark.parametrize(
    "trajectory",
    [Trajectory(frames=3, rotation_deg_s=400), Trajectory(frames=3, velocity_m_s=(15, 0, 0))],
)
def test_a_camera_that_looks_past_the_board_or_flies_through_it_is_refused(trajectory):
    with pytest.raises(ValueError, match=r"frame \d looks past the board at scene.distance_m 2"):
        Plane().build(LIGHT, CAMERA, trajectory)
    with pytest.raises(ValueError, match=r"period_m 0\.01 is less than two pixels.*at least 0\.04"):
        Plane(period_m=0.01).build(LIGHT, CAMERA, SLIDING)


def test_sun_points_lie_on_the_disc_and_have_its_center_as_their_mean():
    sun = Light(level="daylight").lighting().sun
    points = sun.points(64)
    angle = np.degrees(np.arccos(np.clip(points @ sun.direction, -1, 1)))
    assert angle.max() <= 0.265
    # Half of an even disc lies within 1/√2 of its radius.
    assert (angle < 0.265 / np.sqrt(2)).mean() == pytest.approx(0.5, abs=1 / 64)
    np.testing.assert_allclose(points.mean(axis=0), sun.direction, atol=2e-4)
