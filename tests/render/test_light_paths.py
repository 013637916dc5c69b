"""Our light paths against Mitsuba's integrator, and how often they are compiled."""

import numpy as np
import pytest

from megalopta.render import RenderSettings, SceneRenderer, activate, choose_variant, mi
from megalopta.render.film import Film
from megalopta.render.loading.scene import Layers
from megalopta.render.path_tracing import ROULETTE_DEPTH, PathIntegrator
from megalopta.scenes import Forest, Light, PerspectiveCamera, Trajectory, build_scene

PATH = Trajectory(frames=2, position_m=(0, 0, 1.5), look_at_m=(10, 0, 1.5))
SETTINGS = RenderSettings(samples_per_pixel=4, integrator="path")


@pytest.fixture(scope="module")
def forest():
    """A small forest, and whether kernels can be told of."""
    activate(choose_variant("auto"))
    if str(mi.variant()).startswith("scalar"):
        pytest.skip("no kernels in scalar variants")
    camera = PerspectiveCamera(width=4, height=4)
    description = Forest(trees=3, density_per_ha=100)
    return build_scene(description, Light(level="daylight", sky="natural"), camera, PATH)


def renderer(scene, width, height, **settings):
    camera = PerspectiveCamera(width=width, height=height)
    return SceneRenderer(scene, camera, SETTINGS.model_copy(update=settings))


def test_ctrl_c_in_the_loop_is_no_error_of_the_library(forest, monkeypatch):
    def interrupted(*arguments, **more):
        raise KeyboardInterrupt

    scene = mi.load_dict({"type": "scene", "light": {"type": "constant"}})
    sensor = mi.load_dict({"type": "perspective", "film": {"type": "hdrfilm"}})
    monkeypatch.setattr(Layers, "ray_intersect_preliminary", interrupted)
    with pytest.raises(KeyboardInterrupt):
        PathIntegrator(4).render(scene, sensor, seed=1, spp=1)


def test_frames_are_those_of_mitsubas_path_tracer_to_the_last_bit(forest):
    rendering = renderer(forest, 20, 13)
    film, pose = Film(rendering.camera, SETTINGS, 4), PATH.poses()[0]
    depth = SETTINGS.max_depth
    mitsubas = mi.load_dict({"type": "path", "max_depth": depth, "rr_depth": ROULETTE_DEPTH})

    def trace(scene, sensor, seed, spp):
        return np.array(mitsubas.render(scene, sensor, seed=seed, spp=spp), np.float32)

    ours, expected = (
        film.expose(each, rendering._view._loaded, rendering._local(pose), seed=7)
        for each in (PathIntegrator(depth).render, trace)
    )
    np.testing.assert_array_equal(ours, expected)
