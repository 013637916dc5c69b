"""Radiance against closed forms: emitters, planes, furnaces, and light left out for want of hits."""

import math

import numpy as np
import pytest
import trimesh

from megalopta.render import RenderSettings, SceneRenderer, choose_variant, frame_seed
from megalopta.render.baking.integrator import BakedLightIntegrator
from megalopta.render.path_tracing import PathIntegrator, SplitPaths
from megalopta.render.settings import bake_seed, part_seed
from megalopta.scenes import Light, PerspectiveCamera, Scene, Trajectory
from megalopta.scenes.levels import LEVELS
from megalopta.scenes.material import Emission, Material
from megalopta.scenes.scene import Lighting, Sun
from megalopta.scenes.spectra.reflectance import reflectance_of
from megalopta.scenes.spectra.spectrum import Spectrum, flat

from .conftest import band_means, down, quad, renderer_of, scene_of, square, vectorized

BANDS = ((400.0, 450.0), (450.0, 500.0), (500.0, 600.0), (600.0, 700.0), (900.0, 1000.0))
SLOPED = Spectrum((300.0, 500.0, 700.0, 1100.0), (1e-9, 2e-9, 4e-9, 4e-9))
LOOKING_DOWN = down()[0]


def mean_radiance(scene, samples=64, width=160, bands=BANDS, integrator="auto"):
    camera = PerspectiveCamera(width=width, height=width, fov_deg=40)
    settings = RenderSettings(samples_per_pixel=samples, bands_nm=bands, integrator=integrator)
    renderer = SceneRenderer(scene, camera, settings, LOOKING_DOWN[np.newaxis])
    image = renderer.radiance(LOOKING_DOWN, seed=1)
    return image.mean(axis=(0, 1), dtype=np.float64)


def test_constant_emitter_reads_its_radiance_in_every_band():
    scene = Scene({}, {}, (), Lighting(SLOPED))
    # 1.6 million paths of 4 wavelengths over 5 bands leave less than 0.02 % noise.
    np.testing.assert_allclose(mean_radiance(scene), band_means(BANDS, SLOPED), rtol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("integrator", "width"), [("path", 160), ("baked", 72)])
@pytest.mark.parametrize(
    "light",
    [Light(level="airglow"), Light(level="quarter_moon"), Light(level="daylight", cloud_cover=0.5)],
    ids=lambda light: light.level,
)
def test_diffuse_plane_returns_reflectance_times_irradiance_of_all_lights_over_pi(
    ground, light, integrator, width
):
    if integrator == "baked" and choose_variant().name.startswith("scalar"):
        pytest.skip("baking needs a vectorized variant")
    # Mitsuba's own range ends at 830 nm; lines and water bands make both factors uneven.
    bands = ((400.0, 700.0), (700.0, 900.0), (900.0, 1100.0), (1100.0, 1400.0), (1400.0, 1700.0))
    leaf, together = reflectance_of("leaf light"), light.resolved().spectrum()
    scene = scene_of(light.lighting(), (ground, Material(leaf)))
    expected = band_means(bands, leaf, together) / math.pi
    found = mean_radiance(scene, width=width, bands=bands, integrator=integrator)
    # Paths take 1.6 million wavelengths of a band over which light may change by a factor of ten;
    # baked light of more than 4000 pixels is tried on a part of them.
    np.testing.assert_allclose(found, expected, rtol=5e-3)


def test_same_seed_gives_same_bytes_and_another_seed_other_noise(ground):
    ball = trimesh.creation.icosphere(subdivisions=1), Material(flat(0.3))
    camera = PerspectiveCamera(width=16, height=16)
    renderer = renderer_of(camera, ground, ball, lighting=Lighting(SLOPED), samples_per_pixel=4)
    first, again, other = (renderer.radiance(LOOKING_DOWN, seed) for seed in (5, 5, 6))
    assert first.tobytes() == again.tobytes()
    assert first.tobytes() != other.tobytes()


def test_no_two_random_seeds_of_sequences_are_equal():
    instants = [frame_seed(7, *each) for each in np.ndindex(60, 3, 32)]
    of_frames = [frame_seed(seed, frame) for seed in range(20) for frame in range(120)]
    of_passes = [frame_seed(7, *each) for each in np.ndindex(120, 3)]
    of_bakes = [bake_seed(seed) for seed in range(20)]
    for seeds in ([*of_frames, *of_bakes], [*instants, *of_frames[7 * 120 : 8 * 120]], of_passes):
        assert len(set(seeds)) == len(seeds)
    assert len({part_seed(seed, "pass", n) for seed, n in np.ndindex(20, 50)}) == 1000


LEVEL = 2e-9
LOOKING = Trajectory(frames=2, position_m=(-4, 0.5, 1.0), look_at_m=(0, 0, 0)).poses()
CAMERA = PerspectiveCamera(width=64, height=64, fov_deg=30)
FURNACE = {"lighting": Lighting(flat(LEVEL)), "samples_per_pixel": 256}


def test_white_sphere_vanishes_in_its_environment():
    white = trimesh.creation.icosphere(subdivisions=4), Material(flat(1.0))
    image = renderer_of(CAMERA, white, **FURNACE, max_depth=2).radiance(LOOKING[0], 1)
    assert image.mean(dtype=np.float64) == pytest.approx(LEVEL, rel=1e-3)  # required: 0.1 %
    np.testing.assert_allclose(image[..., 0], LEVEL, rtol=0.1)  # nor is its outline seen


@vectorized
@pytest.mark.parametrize(
    "kind", [SplitPaths, PathIntegrator, pytest.param(BakedLightIntegrator, marks=pytest.mark.slow)]
)
def test_white_bowl_vanishes_in_its_environment(kind):
    bowl = trimesh.creation.icosphere(subdivisions=4)
    bowl.update_faces(bowl.triangles_center[:, 0] > 0)  # open toward the camera
    things = [(bowl, Material(flat(1.0)))]
    if kind is PathIntegrator:  # a lamp, though it is hardly seen, forbids to split paths
        things.append((square(-9, 0.01), Material(flat(0.0), None, Emission(LEVEL))))
    integrator = "baked" if kind is BakedLightIntegrator else "path"
    renderer = renderer_of(CAMERA, *things, poses=LOOKING, integrator=integrator, **FURNACE)
    assert isinstance(renderer._view._integrator, kind)
    mean = renderer.radiance(LOOKING[0], 1).mean(dtype=np.float64)
    # One of two paths leaves half a sphere at each hit: 15 hits miss 3e-5. Split paths, of which one
    # in 16 is followed, scatter by 7e-4 (σ), others less.
    assert mean == pytest.approx(LEVEL, rel=4e-3)


LONGER_PATHS_BANDS = (500.0, 600.0), (800.0, 900.0)
REFLECTANCES = 0.2, 0.8
DOWN = Trajectory(frames=2, look_at_m=(0.01, 0, -50), up=(1, 0, 0)).poses()[0]


def of_walls(max_depth, wall):
    """Of walls that are 0.625 of a sphere."""
    sphere = trimesh.creation.icosphere(subdivisions=4, radius=200.0)
    highest = np.sort(sphere.triangles_center[:, 2])[round(0.625 * len(sphere.faces)) - 1]
    sphere.update_faces(sphere.triangles_center[:, 2] <= highest)
    camera = PerspectiveCamera(width=48, height=48, fov_deg=60)
    given = {"bands_nm": LONGER_PATHS_BANDS, "samples_per_pixel": 64, "max_depth": max_depth}
    return renderer_of(camera, (sphere, Material(wall)), lighting=Lighting(flat(1.0)), **given)


@pytest.mark.parametrize("max_depth", [2, 3, 5])
def test_share_is_the_rest_of_a_geometric_series(max_depth):
    # Every place in a sphere gets equally much of every other: of the light that leaves the walls,
    # their share of the sphere comes back, and each hit keeps the reflectance of it.
    kept = 0.625 * np.array(REFLECTANCES)
    # Of 35 000 paths one in 2 to 16 goes on in the bright band: up to 3 % (σ), four of them.
    expected = kept ** (max_depth - 1)
    wall = Spectrum((400.0, 650.0, 750.0, 1000.0), np.repeat(REFLECTANCES, 2).tolist())
    found = of_walls(max_depth, wall).light_left_out(DOWN)
    np.testing.assert_allclose(found, expected, rtol=0.12, atol=1e-3)


def test_meter_counts_hits_as_frames_do():
    """Of light of the sky, and that which met the walls once."""
    measured = of_walls(3, flat(0.8)).light_survey(np.zeros((16, 3)))
    expected = 0.375 * (1 + 0.8 * 0.625) * measured.unshaded.lux
    # 65 536 paths that bring 0.56 ± 0.47 of the sky's light: 0.3 % (σ). One hit more is 17 %.
    found = np.mean([point.lux for point in measured.ground])
    assert found == pytest.approx(expected, rel=0.02)


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
