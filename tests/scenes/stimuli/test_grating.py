import math

import numpy as np
import pytest

from megalopta.assets_gen.grating import sine_grating
from megalopta.scenes.cameras.panoramic import CylindricalCamera
from megalopta.scenes.cameras.perspective import PerspectiveCamera
from megalopta.scenes.light import Light
from megalopta.scenes.stimuli.grating import Grating
from megalopta.scenes.trajectories.steady import Trajectory

TURNING = Trajectory(rotation_deg_s=15)
CAMERA = PerspectiveCamera(width=120, height=120, fov_deg=72)


@pytest.mark.parametrize(("variant", "factor"), [("rot", math.sqrt(2)), ("periodic", 1.0)])
def test_grating_is_one_moving_and_one_static_grating(variant, factor):
    x, y = np.meshgrid(np.linspace(0, 1, 40), np.linspace(0, 1, 30))
    value = sine_grating(x, y, 0.8, 3.0, (0.3, 1.1), variant)
    moving = np.cos(2 * np.pi * factor * 3 * x + 0.3 - 1.1)
    static = np.cos(2 * np.pi * factor * 3 * y + 0.3 + 1.1)
    np.testing.assert_allclose(value, 1 + 0.4 * (moving - static), atol=1e-12)


def test_a_frequency_that_does_not_close_is_refused_with_one_that_does():
    with pytest.raises(ValueError, match=r"does not close: use 4\.2$"):
        Grating(cycles_per_frame=4.25).build(Light(), CAMERA, TURNING)


@pytest.mark.parametrize(
    ("change", "remedy"),
    [
        ({"look_at_m": (10, 0, 1.0)}, r"look_at_m \(10.* give it the height 1\.5"),
        ({"up": (0, 0.1, 1)}, r"up \(0.* use \(0, 0, 1\)"),
        ({"up": (0, 0, -1)}, r"up \(0.* use \(0, 0, 1\)"),
        ({"velocity_m_s": (0, 0, 0.1)}, r"velocity_m_s \(0.* turn with rotation_deg_s"),
    ],
)
def test_a_trajectory_that_looks_past_the_wall_is_refused(change, remedy):
    with pytest.raises(ValueError, match=remedy):
        Grating().build(Light(), CAMERA, Trajectory(**change))


def test_the_wall_is_as_high_as_an_asymmetric_panorama_sees():
    camera = CylindricalCamera(lower_deg=-20, upper_deg=50)
    wall = Grating().build(Light(), camera, TURNING).assets["grating"].parts["grating"]
    assert wall.bounds[1, 2] / 10 == pytest.approx(1.05 * math.tan(math.radians(50)))


@pytest.mark.parametrize("pattern", ["sine", "square"])
def test_bars_keep_their_phase_up_the_wall_and_close_around_it(pattern):
    grating = Grating(pattern=pattern, contrast=0.5, cycles_per_frame=4)
    emission = grating.build(Light(), CAMERA, TURNING).materials["grating"].emission
    assert (emission.pattern == emission.pattern[:1]).all()
    angle = (np.arange(4096) + 0.5) / 4096 * 2 * np.pi
    wave = -np.sin(4 * 360 / 72 * angle)
    expected = 1 + 0.5 * (np.sign(wave) if pattern == "square" else wave)
    np.testing.assert_allclose(emission.pattern[0], expected, atol=1e-5)
