import numpy as np
import pytest

from megalopta.render import RenderSettings, SceneRenderer
from megalopta.scenes import Light, MotionBench, PerspectiveCamera, Plane, Trajectory
from megalopta.scenes.spectra.spectrum import flat, luminous

CAMERA = PerspectiveCamera(width=64, height=16, fov_deg=40)
SLIDING = Trajectory(frames=4, velocity_m_s=(0, -0.3, 0))
SETTINGS = RenderSettings(samples_per_pixel=256, max_depth=2, bands_nm=((500, 600),))
LUX = 2.0
LIGHT = Light(illuminance_lux=LUX)
ONE_LUX = 1 / np.pi / luminous(flat(1.0))


def row(plane, trajectory=SLIDING, frame=0):
    """Middle row of a rendered frame, 1 where the luminance is the mean."""
    scene = plane.build(LIGHT, CAMERA, trajectory)
    renderer = SceneRenderer(scene, CAMERA, SETTINGS)
    radiance = renderer.radiance(trajectory.poses()[frame], 1)[8, :, 0]
    return radiance / (LUX * ONE_LUX)


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


ROW = PerspectiveCamera(width=16, height=1, fov_deg=20)
# To the right at 10 mm/s, the dissertation's fastest: 16.7 pixels of 60 µm a frame.
FAST = Trajectory(frames=3, position_m=(0, 0, 0), look_at_m=(1, 0, 0), velocity_m_s=(0, -0.01, 0))


def rendered(bench, trajectory, frame):
    scene = bench.build(Light(), ROW, trajectory)
    renderer = SceneRenderer(scene, ROW, SETTINGS)
    return renderer, renderer.radiance(trajectory.poses()[frame], 1)[0, :, 0] / ONE_LUX


def test_the_row_sees_the_beam_until_the_edge_arrives_and_then_the_plates_shade():
    bench = MotionBench(edge_mm=0.3)
    _, first = rendered(bench, FAST, 0)
    # the edge stands 0.3 mm = 5 pixels right of the middle of the row
    expected = np.where(np.arange(16) + 0.5 - 8 < 5, 1.0, 27 / 65)
    np.testing.assert_allclose(first, expected, rtol=1e-5)
    _, halved = rendered(MotionBench(edge_mm=0.03), FAST, 0)
    # 256 stratified samples place the edge to 1/16 of a pixel or better
    assert halved[8] == pytest.approx((1 + 27 / 65) / 2, abs=0.6 / 16)
    _, second = rendered(bench, FAST, 1)
    np.testing.assert_allclose(second, 27 / 65, rtol=1e-5)


def test_the_speeds_are_the_dissertations_pixels_per_frame():
    renderer, _ = rendered(MotionBench(), FAST, 0)
    flow = renderer.truth(FAST.poses(), 0).flow_forward[0]
    # 10 mm/s · 0.1 s / 60 µm; the renderer's float32 positions are good to 1e-4 px here
    np.testing.assert_allclose(flow[:, 0], -10 * 0.1 / 0.06, atol=2e-4)
    np.testing.assert_allclose(flow[:, 1], 0, atol=2e-4)
