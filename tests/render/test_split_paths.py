"""Our light paths, whole and split, against Mitsuba's path tracer in every kind of light."""

from functools import cache

import numpy as np
import pytest

from megalopta.render import RenderSettings, SceneRenderer, activate, choose_variant, mi
from megalopta.render.film import Film
from megalopta.render.loading.scene import Layers
from megalopta.render.path_tracing import ROULETTE_DEPTH, PathIntegrator, SplitPaths
from megalopta.scenes import Forest, Light, PerspectiveCamera, Trajectory, build_scene

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


@cache
def forest(light):
    return build_scene(FOREST, LIGHTS[light], CAMERA, PATH)


def rendering(light, **settings):
    activate(choose_variant("auto"))
    settings = RenderSettings(**{"samples_per_pixel": 64, "integrator": "path", **settings})
    return SceneRenderer(forest(light), CAMERA, settings)


@pytest.mark.slow
@vectorized
@pytest.mark.parametrize("name", LIGHTS)
def test_every_band_has_the_mean_of_mitsubas_path_tracer(name):
    renderer = rendering(name, samples_per_pixel=256, bands_nm=BANDS)
    view, pose = renderer._view, renderer._local(PATH.poses()[0])
    assert isinstance(view._integrator, SplitPaths)
    settings = RenderSettings(samples_per_pixel=256, bands_nm=BANDS)
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
def test_ctrl_c_in_the_loop_is_no_error_of_the_library(monkeypatch):
    def interrupted(*arguments, **more):
        raise KeyboardInterrupt

    activate(choose_variant("auto"))
    scene = mi.load_dict({"type": "scene", "light": {"type": "constant"}})
    sensor = mi.load_dict({"type": "perspective", "film": {"type": "hdrfilm"}})
    monkeypatch.setattr(Layers, "ray_intersect_preliminary", interrupted)
    with pytest.raises(KeyboardInterrupt):
        PathIntegrator(4).render(scene, sensor, seed=1, spp=1)


@vectorized
def test_frames_are_those_of_mitsubas_path_tracer_to_the_last_bit():
    settings = RenderSettings(samples_per_pixel=4, integrator="path")
    renderer = rendering("natural daylight", samples_per_pixel=4)
    film, pose, depth = Film(CAMERA, settings, 4), PATH.poses()[0], settings.max_depth
    mitsubas = mi.load_dict({"type": "path", "max_depth": depth, "rr_depth": ROULETTE_DEPTH})

    def trace(scene, sensor, seed, spp):
        return np.array(mitsubas.render(scene, sensor, seed=seed, spp=spp), np.float32)

    ours, expected = (
        film.expose(each, renderer._view._loaded, renderer._local(pose), seed=7)
        for each in (PathIntegrator(depth).render, trace)
    )
    np.testing.assert_array_equal(ours, expected)
