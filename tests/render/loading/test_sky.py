"""Skies that differ from direction to direction, against closed forms.

Radiance 1 + x toward the direction (x, y, z) gives a plane with normal n the irradiance
∫ (1 + n'x) (d·n)⁺ dω = π + (2π/3) nₓ, and even light L the irradiance πL.
"""

import math

import numpy as np
import pytest

from megalopta.render import RenderSettings, SceneRenderer
from megalopta.scenes import PerspectiveCamera, Trajectory
from megalopta.scenes.material import Material
from megalopta.scenes.scene import Lighting, SkyPattern, pattern_directions
from megalopta.scenes.spectra.spectrum import Spectrum, flat

from ..conftest import quad, scene_of, vectorized

INTEGRATORS = ["path", pytest.param("baked", marks=[vectorized, pytest.mark.slow])]
BANDS = ((500.0, 600.0), (1400.0, 1500.0))
ROWS = 90
RED, BLUE = Spectrum((500.0, 1500.0), (1e-9, 3e-9)), Spectrum((500.0, 1500.0), (4e-9, 2e-9))
IN_BANDS = [[each(np.linspace(*band, 1001)).mean() for band in BANDS] for each in (RED, BLUE)]
ALONG_X, UPWARD = (1 + pattern_directions(ROWS)[..., axis] for axis in (0, 2))
SKY = Lighting(
    flat(1e-9),
    patterns=(
        SkyPattern(RED, ALONG_X.astype(np.float32)),
        SkyPattern(BLUE, UPWARD.astype(np.float32)),
    ),
)
ALBEDO, THROUGH = 0.5, 0.3


def wall(lighting, tilt_deg):
    """A leaf with its normal in the plane of x and z, from +x upward by the tilt, and its view."""
    tilt = math.radians(tilt_deg)
    normal = np.array([math.cos(tilt), 0, math.sin(tilt)])
    up = np.array([-math.sin(tilt), 0, math.cos(tilt)])
    side = np.array([0, 1.0, 0])
    corners = [a * side + b * up for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    leaf = Material(flat(ALBEDO), transmittance=flat(THROUGH))
    scene = scene_of(lighting, (quad(np.array(corners)), leaf))
    look = Trajectory(
        frames=2, position_m=tuple(4 * normal), look_at_m=(0, 0, 0), up=tuple(up)
    ).poses()
    return scene, look, normal


def rendered(scene, poses, integrator="path", width=8, fov_deg=10.0, samples=256):
    settings = RenderSettings(
        bands_nm=BANDS, samples_per_pixel=samples, max_depth=2, integrator=integrator
    )
    camera = PerspectiveCamera(width=width, height=width, fov_deg=fov_deg)
    return SceneRenderer(scene, camera, settings, poses).radiance(poses[0], 1)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("tilt_deg", [0, 50, 180])
def test_a_leaf_shows_both_of_its_sides_share_of_the_sky(integrator, tilt_deg):
    scene, poses, normal = wall(SKY, tilt_deg)
    found = rendered(scene, poses, integrator).mean(axis=(0, 1), dtype=np.float64)
    expected = np.zeros(len(BANDS))
    for share, facing in ((ALBEDO, normal), (THROUGH, -normal)):
        expected += share * 1e-9
        for spectrum, axis in zip(IN_BANDS, (0, 2), strict=True):
            expected += share * np.array(spectrum) * (1 + 2 / 3 * facing[axis])
    # 16 000 paths, whose values scatter by less than their mean: σ of 0.6 %.
    np.testing.assert_allclose(found, expected, rtol=0.03 if integrator == "path" else 0.02)


def test_the_sky_itself_is_the_sum_of_its_patterns():
    scene, _, _ = wall(SKY, 0)
    looking = Trajectory(frames=2, position_m=(0, 5, 0), look_at_m=(2, 9, 3)).poses()
    toward = np.array([2, 4, 3]) / np.linalg.norm([2, 4, 3])
    found = rendered(scene, looking, fov_deg=1.0).mean(axis=(0, 1), dtype=np.float64)
    expected = np.full(2, 1e-9)
    for spectrum, axis in zip(IN_BANDS, (0, 2), strict=True):
        expected += np.array(spectrum) * (1 + toward[axis])
    # 16 000 paths, whose four wavelengths fall into either band by chance: σ of 0.4 %.
    np.testing.assert_allclose(found, expected, rtol=0.02)
