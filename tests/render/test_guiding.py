"""The guide's density, its light against plain paths, and the numbers of samples."""

import numpy as np
import pytest
import trimesh

from megalopta.render import RenderSettings, SceneRenderer, activate, choose_variant, dr, mi
from megalopta.render.guiding import Looks, OpenSky
from megalopta.render.loading.sky import sky_of
from megalopta.render.path_tracing import PathIntegrator, SplitPaths
from megalopta.scenes import PerspectiveCamera, Trajectory
from megalopta.scenes.material import Material
from megalopta.scenes.scene import Lamp, Lighting, Sun
from megalopta.scenes.spectra.spectrum import flat

from .conftest import scene_of, vectorized

pytestmark = vectorized
BINS = 128
CAMERA = PerspectiveCamera(width=24, height=18, fov_deg=70)
POSES = Trajectory(frames=8, position_m=(-2.6, -1.2, 1.5), look_at_m=(1, 1, 1)).poses()


def room():
    """Bright walls and a window of 1.2 m, with a box on the floor."""
    parts = [
        [(0, 0, -0.05), (6, 4, 0.1)], [(0, 0, 2.75), (6, 4, 0.1)],
        [(0, 2.05, 1.35), (6, 0.1, 2.8)], [(0, -2.05, 1.35), (6, 0.1, 2.8)],
        [(-3.05, 0, 1.35), (0.1, 4, 2.8)], [(3.05, 0, 0.45), (0.1, 4, 0.9)],
        [(3.05, 0, 2.4), (0.1, 4, 0.6)], [(3.05, -1.3, 1.5), (0.1, 1.4, 1.2)],
        [(3.05, 1.3, 1.5), (0.1, 1.4, 1.2)], [(-1, 0.8, 0.4), (1.2, 0.8, 0.8)],
    ]  # fmt: skip
    boxes = [trimesh.creation.box(size, trimesh.transformations.translation_matrix(at))
             for at, size in parts]  # fmt: skip
    return trimesh.util.concatenate(boxes), Material(flat(0.7))


def rendering(lighting, integrator, samples, **more):
    settings = RenderSettings(
        samples_per_pixel=samples, max_depth=32, bands_nm=((500, 600),), integrator=integrator
    )
    return SceneRenderer(scene_of(lighting, room(), **more), CAMERA, settings, POSES)


def test_directions_are_drawn_with_the_density_that_is_stated():
    activate(choose_variant("auto"))
    random = np.random.default_rng(1)
    points = random.random((3, 5000)).astype(np.float32)
    light = random.random(5000) * (random.random(5000) < 0.2)
    guide = OpenSky(Looks(points, random.integers(BINS, size=5000), light, np.ones(5000)))
    count, place = 2**20, mi.Point3f(0.3, 0.6, 0.9)
    sample = mi.Point2f(random.random((2, count), np.float32))
    direction, density = guide.sample(place, sample, True)
    # But for rounding at the edges of bins.
    same = np.isclose(guide.density(place, direction, True), density, rtol=1e-4)
    assert same.mean() > 1 - 1e-4
    # In bins of equal solid angle, the chance is density times solid angle.
    ring = np.minimum((1 - np.array(direction.z)) * 4, 7).astype(int)
    turn = np.array(dr.atan2(direction.y, direction.x)) / (2 * np.pi) + 0.5
    drawn = np.bincount(ring * 16 + np.minimum(turn * 16, 15).astype(int), minlength=BINS)
    expected = guide.densities(np.tile([[0.3], [0.6], [0.9]], BINS), np.arange(BINS))
    expected *= 4 * np.pi / BINS * count
    assert np.isclose(expected.sum(), count, rtol=1e-4)
    # χ² of 127 degrees of freedom exceeds 230 with a probability of 5e-8.
    assert ((drawn - expected) ** 2 / expected).sum() < 230


@pytest.mark.slow
@pytest.mark.parametrize(
    "lighting, variance",
    [(Lighting(flat(1e-6)), 0.5), (Lighting(flat(1e-6), Sun((0.8, 0.1, 0.6), flat(1e-5))), 0.75)],
)
def test_a_guided_room_has_the_light_of_plain_paths_and_less_noise(lighting, variance):
    means, scatters = [], []
    for integrator in ("path", "plain"):
        renderer = rendering(lighting, integrator, 256)
        is_guided = isinstance(sky_of(renderer._loaded).directions, OpenSky)
        assert is_guided == (integrator == "path")
        kind = SplitPaths if is_guided else PathIntegrator
        assert isinstance(renderer._view._integrator, kind)
        frames = np.array([renderer.radiance(POSES[0], seed) for seed in range(12)], np.float64)
        means.append(frames.mean(axis=(1, 2, 3)))
        scatters.append(frames.var(axis=0, ddof=1).mean())
    guided, plain = means
    scatter = np.sqrt((guided.var(ddof=1) + plain.var(ddof=1)) / 12)
    assert scatter < 0.01 * plain.mean()
    # Of 22 degrees of freedom: beyond 7 with a probability of 5e-7.
    assert abs(guided.mean() - plain.mean()) < 7 * scatter
    assert scatters[0] < variance * scatters[1]


def test_samples_follow_the_noise_and_are_the_same_again():
    shares = [rendering(Lighting(flat(1e-6)), "path", 128)._view._integrator.shares for _ in "ab"]
    assert shares[0] == shares[1]
    # In a room most light and noise comes from walls; forests take 1/16.
    assert shares[0][0] == 1
    assert shares[0][1] > 0.25


def test_a_guided_scene_keeps_its_lamps_whose_light_is_not_split():
    lamps = (Lamp("point", flat(1e-6), np.eye(4)),)
    renderer = rendering(Lighting(flat(1e-6)), "auto", 128, lamps=lamps)
    assert isinstance(sky_of(renderer._loaded).directions, OpenSky)
    assert len(renderer._loaded.emitters()) == 2
    assert isinstance(renderer._view._integrator, PathIntegrator)
