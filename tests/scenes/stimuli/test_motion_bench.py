import numpy as np
import pytest

from megalopta.render import RenderSettings, SceneRenderer
from megalopta.scenes import Light, MotionBench, PerspectiveCamera, Trajectory
from megalopta.scenes.spectra.spectrum import flat, luminous

ROW = PerspectiveCamera(width=16, height=1, fov_deg=20)
SETTINGS = RenderSettings(samples_per_pixel=256, max_depth=2, bands_nm=((690, 710),))
# To the right at 10 mm/s, the dissertation's fastest: 16.7 pixels of 60 µm a frame.
FAST = Trajectory(frames=3, position_m=(0, 0, 0), look_at_m=(1, 0, 0), velocity_m_s=(0, -0.01, 0))
RADIANCE = 1 / np.pi / luminous(flat(1.0))


def rendered(bench, trajectory, frame):
    scene = bench.build(Light(), ROW, trajectory)
    renderer = SceneRenderer(scene, ROW, SETTINGS)
    return renderer, renderer.radiance(trajectory.poses()[frame], 1)[0, :, 0] / RADIANCE


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
