import math

import numpy as np
import pytest
import trimesh

from megalopta.render import RenderSettings, SceneRenderer
from megalopta.render.loading.meshes import merge
from megalopta.render.loading.scene import load_scene
from megalopta.render.surveys import LightMeter
from megalopta.scenes import Light, PerspectiveCamera, Trajectory
from megalopta.scenes.levels import LEVELS
from megalopta.scenes.material import Material
from megalopta.scenes.scene import Lighting, Sun
from megalopta.scenes.spectra.spectrum import flat, luminous

from .conftest import quad, renderer_of, scene_of

# Elements of 10 nm over V(λ).


def survey(lighting, place, *things):
    camera = PerspectiveCamera(width=4, height=4)
    renderer = renderer_of(camera, *things, lighting=lighting, max_depth=3)
    return renderer.light_survey(np.array([place], np.float64))


@pytest.mark.parametrize("level", LEVELS)
def test_unshaded_ground_gets_the_illuminance_of_every_named_level(level, ground):
    measured = survey(Light(level=level).lighting(), (0, 0, 1.5), ground)
    lux = LEVELS[level].illuminance_lux
    # Required: 2 %. 4096 paths with four wavelengths each leave 0.05 % (σ).
    assert measured.unshaded.lux == pytest.approx(lux, rel=4e-3)
    assert measured.ground[0].lux == pytest.approx(lux, rel=4e-3)
    assert measured.ground[0].position_m == pytest.approx((0, 0, 0.02), abs=1e-5)


def test_a_black_wall_takes_half_the_sky(ground):
    wall = quad(np.array([[0, -1e4, 0], [0, 1e4, 0], [0, 1e4, 1e4], [0, -1e4, 1e4]]))
    sky = Light(level="twilight").lighting()
    measured = survey(sky, (0.1, 0, 1.5), ground, (wall, Material(flat(0.0))))
    # What the 10 km leave open is below 1e-4; half of 4096 paths: σ of 0.008.
    assert measured.ground[0].lux == pytest.approx(0.5, abs=0.045)
    assert measured.ground[0].standard_error_lux == pytest.approx(0.5 / 64, rel=0.1)
    assert measured.unshaded.lux == pytest.approx(1.0, rel=4e-3)


def test_edge_of_a_shadow_is_as_soft_as_the_disc_of_the_sun_makes_it(ground):
    height = 10.0  # of a roof that ends at x = 0
    roof = quad(
        np.array([[-50, -50, height], [0, -50, height], [0, 50, height], [-50, 50, height]])
    )
    overhead = Lighting(flat(0.0), Sun((0.0, 0.0, 1.0), flat(1.0)))
    camera = PerspectiveCamera(width=32, height=32, fov_deg=math.degrees(2 * math.atan(0.08 / 5)))
    look_down = Trajectory(frames=2, position_m=(0, 0, 5), look_at_m=(0, 0, 0), up=(0, 1, 0))
    given = {"lighting": overhead, "samples_per_pixel": 256, "max_depth": 2}
    renderer = renderer_of(camera, ground, (roof, Material(flat(0.0))), **given)
    image = renderer.radiance(look_down.poses()[0], seed=0)[..., 0]
    profile = image.mean(axis=0, dtype=np.float64) * math.pi / 0.5
    # Share of a disc of radius 1 beyond a chord at −x: its segment's area over π.
    x = ((np.arange(32) + 0.5) / 16 - 1) * 0.08 / (height * math.tan(math.radians(0.265)))
    chord = np.clip(x, -1, 1)
    share = 0.5 + (chord * np.sqrt(1 - chord**2) + np.arcsin(chord)) / math.pi
    # A chord cuts off a number of 64 points that is right to about 2.
    np.testing.assert_allclose(profile, share, atol=0.04)


@pytest.mark.slow
def test_meter_and_frames_agree_in_an_integrating_sphere():
    """Which is open above, and so large that 2 cm are nothing to it."""
    max_depth = 3
    sphere, reflectance = trimesh.creation.icosphere(subdivisions=5, radius=200.0), 0.8
    sphere.update_faces(sphere.triangles_center[:, 2] < 50)
    scene = scene_of(Lighting(flat(1.0)), (sphere, Material(flat(reflectance))))
    look_down = Trajectory(
        frames=2, position_m=(1.3, 0.7, 0), look_at_m=(1.3, 0.7, -50), up=(1, 0, 0)
    )
    settings = RenderSettings(
        bands_nm=((500, 600),), samples_per_pixel=784, max_depth=max_depth, integrator="path"
    )
    camera = PerspectiveCamera(width=64, height=64, fov_deg=2)
    renderer = SceneRenderer(scene, camera, settings)
    radiance = renderer.radiance(look_down.poses()[0], seed=3).mean(dtype=np.float64)
    below = renderer.light_survey(np.array([[1.3, 0.7, 0]])).ground[0].position_m
    meter = LightMeter(load_scene(scene, merge(scene)), scene.lighting, max_depth)
    lux = [meter.measure(np.array(below), seed).lux for seed in range(784)]
    # A path brings 1 ± 1.3 in units of the mean: 3.2 million of them know it to 0.07 % (σ), two such
    # means differ by 0.1 %, and by 0.5 % once in two million times. A bounce too many is 6 % or
    # more, a facet's tilt of a degree 0.02 %.
    assert np.std(lux) / np.mean(lux) / 28 < 8e-4
    expected = luminous(flat(math.pi)) * radiance / reflectance
    assert np.mean(lux) == pytest.approx(expected, rel=5e-3)
