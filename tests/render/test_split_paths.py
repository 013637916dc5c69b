"""Split paths against Mitsuba's path tracer, band by band, in every kind of light."""

import gc
import weakref

import numpy as np
import pytest

from megalopta.render import RenderSettings, SceneRenderer, activate, choose_variant
from megalopta.render.path_tracing import PathIntegrator
from megalopta.render.sensors.film import Film
from megalopta.render.split_paths import SplitPaths
from megalopta.scenes import Forest, Light, MovingObject, PerspectiveCamera, Shutter, Trajectory
from megalopta.scenes.build import build_scene
from megalopta.scenes.motion import Drift

from .conftest import vectorized

PATH = Trajectory(frames=2, position_m=(0, 0, 1.5), look_at_m=(10, 0, 1.5))
CAMERA = PerspectiveCamera(width=40, height=30, fov_deg=60)
# Without gaps: Mitsuba's film reads a band beside a gap up to 13 % wrong.
BANDS = tuple((lower, lower + 100) for lower in range(400, 900, 100))
FOREST = Forest(trees=6, density_per_ha=100)
LIGHTS = {
    "daylight": Light(level="daylight"),
    "natural daylight": Light(level="daylight", sky="natural"),
    "natural twilight": Light(level="twilight", sky="natural"),
    "starlight": Light(level="starlight"),
}


def rendering(light, settings, objects=()):
    activate(choose_variant("auto"))
    scene = build_scene(FOREST, light, CAMERA, PATH, objects)
    return SceneRenderer(scene, CAMERA, settings)


@pytest.mark.slow
@vectorized
@pytest.mark.parametrize("name", LIGHTS)
def test_every_band_has_the_mean_of_mitsubas_path_tracer(name):
    settings = RenderSettings(samples_per_pixel=256, integrator="path", bands_nm=BANDS)
    renderer = rendering(LIGHTS[name], settings)
    view, pose = renderer._view, renderer._local(PATH.poses()[0])
    assert isinstance(view._integrator, SplitPaths)
    film = Film(CAMERA, settings, 256)
    means = [
        np.array([film.expose(each.render, view._loaded, pose, seed) for seed in range(8)])
        for each in (view._integrator, PathIntegrator(settings.max_depth))
    ]
    found, expected = (each.mean(axis=(1, 2), dtype=np.float64) for each in means)
    scatter = np.sqrt((found.var(axis=0, ddof=1) + expected.var(axis=0, ddof=1)) / 8)
    assert (scatter < 0.01 * expected.mean(axis=0)).all()
    # Five bands of four lights: 20 differences, each over a scatter from 14 degrees of freedom,
    # exceed 8 with a probability of 3e-5 · 1e-2.
    assert (np.abs(found.mean(axis=0) - expected.mean(axis=0)) < 8 * scatter).all()


@vectorized
def test_a_band_reads_the_same_beside_others_with_gaps_between():
    def mean(*bands):
        settings = RenderSettings(samples_per_pixel=64, integrator="path", bands_nm=bands)
        renderer, pose = rendering(LIGHTS["starlight"], settings), PATH.poses()[0]
        images = [renderer.radiance(pose, seed)[..., -1] for seed in range(4)]
        means = np.mean(images, axis=(1, 2), dtype=np.float64)
        return means.mean(), means.std(ddof=1) / 2

    alone, scatter = mean((750, 900))
    beside, other = mean((400, 500), (750, 900))
    assert scatter < 0.01 * alone
    # Where 13 % would be an error; of two scatters from 3 degrees of freedom each, 20 are 1e-6.
    assert abs(beside - alone) < min(20 * np.hypot(scatter, other), 0.06 * alone)


@vectorized
def test_a_moving_object_of_two_scenes_is_lit_as_in_one():
    box = MovingObject(
        position_m=(4, 0, 1.5), size_m=(0.5, 0.5, 0.5), motion=Drift(velocity_m_s=(0, 1, 0))
    )
    settings = RenderSettings(samples_per_pixel=64, integrator="path")
    renderer = rendering(Light(level="daylight"), settings, [box])
    assert renderer._view._integrator.exposing is not renderer._view._integrator
    sharp = renderer.radiance(PATH.poses()[0], 3)
    instant = Shutter(exposure_s=1e-9, poses=1)
    exposed = renderer.exposed(PATH, instant, 0, 3)
    noise = sharp.std(axis=(0, 1)).max() / np.sqrt(sharp[..., 0].size)
    np.testing.assert_allclose(exposed.mean((0, 1)), sharp.mean((0, 1)), atol=5 * noise)


@vectorized
@pytest.mark.parametrize("depth", [1, 2, 3])
def test_a_depth_limit_leaves_parts_out(depth):
    settings = RenderSettings(samples_per_pixel=64, integrator="path", max_depth=depth)
    renderer = rendering(Light(level="daylight"), settings)
    seen = renderer.measured(PATH.poses()[0], 1)
    surfaces = seen.radiance[seen.sky == 0]
    assert (surfaces.sum() > 0) == (depth > 1)
    if depth == 2:
        deeper = rendering(Light(level="daylight"), settings.model_copy(update={"max_depth": 3}))
        more = deeper.measured(PATH.poses()[0], 1).radiance[seen.sky == 0]
        assert (more >= surfaces).all()
        assert more.sum() > surfaces.sum()


@vectorized
def test_a_renderer_is_freed_at_once():
    # A scene that the garbage collector frees while paths are traced ends the process.
    renderer = rendering(Light(level="daylight"), RenderSettings(integrator="path"))
    integrator = weakref.ref(renderer._view._integrator)
    gc.disable()
    try:
        del renderer
        assert integrator() is None
    finally:
        gc.enable()
