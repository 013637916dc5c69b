"""Recorded loops of light paths: the bytes of traced ones, whatever changes from frame to frame."""

import gc
import weakref

import numpy as np
import pytest
import trimesh

from megalopta.render import RenderSettings, SceneRenderer, dr, mi
from megalopta.render.path_tracing import BandPaths
from megalopta.scenes import Forest, Light, PerspectiveCamera, Shutter, Trajectory, build_scene
from megalopta.scenes.material import Emission, Material
from megalopta.scenes.spectra.spectrum import flat

from . import test_moving as moving
from .conftest import scene_of, vectorized

pytestmark = vectorized
CAMERA = PerspectiveCamera(width=24, height=18, fov_deg=70)
PATH = Trajectory(frames=3, position_m=(0, 0, 1.5), look_at_m=(10, 0, 1.5))
# Two groups of wavelengths: the second repeats one, and its random numbers follow the first's.
BANDS = tuple((lower, lower + 50) for lower in range(400, 700, 50))
SETTINGS = RenderSettings(samples_per_pixel=4, integrator="path", bands_nm=BANDS, max_depth=4)
FEW = SETTINGS.model_copy(update={"bands_nm": BANDS[:1]})
FOREST, POSTS = Forest(trees=3, density_per_ha=100), moving.scene()


def forest(**light):
    return build_scene(FOREST, Light(**light), CAMERA, PATH)


def with_and_without(render):
    """Images of a function, by recordings and without."""
    images = []
    for is_recorded in (True, False):
        with dr.scoped_set_flag(dr.JitFlag.KernelFreezing, is_recorded):
            images.append(render())
    return images


SUNS = {"level": "daylight"}, {"level": "twilight", "sky": "natural"}


@pytest.mark.parametrize("lights", [(), pytest.param(SUNS, marks=pytest.mark.slow)])
def test_frames_of_several_suns_and_poses_are_those_of_traced_loops(lights):
    scenes = [forest(**light) for light in lights] or [POSTS]
    poses, settings = PATH.poses(), SETTINGS if lights else FEW

    def render():
        renderers = [SceneRenderer(scene, CAMERA, settings) for scene in scenes]
        return [each.radiance(poses[frame], frame) for frame in range(3) for each in renderers]

    np.testing.assert_array_equal(*with_and_without(render))


@pytest.mark.slow
def test_moving_objects_are_where_they_are():
    scene, path = moving.scene(*moving.SPINNING), moving.WATCH
    poses, times = path.poses(), path.times_s.tolist()

    def render():
        renderer = SceneRenderer(scene, CAMERA, SETTINGS)
        sharp = [renderer.radiance(poses[k], k, times[k]) for k in (0, 1, 2, 0, 1)]
        shutter = Shutter(exposure_s=0.1, poses=3)
        return sharp + [renderer.exposed(path, shutter, frame, seed=2) for frame in (0, 1)]

    np.testing.assert_array_equal(*with_and_without(render))


def glowing():
    """Room of walls that glow in a pattern, whose tables Mitsuba makes when they are sampled."""
    box = trimesh.creation.box((4, 4, 4))
    box.invert()
    box.visual = trimesh.visual.TextureVisuals(uv=box.vertices[:, :2])
    pattern = np.random.default_rng(1).random((8, 8)).astype(np.float32)
    return scene_of(None, (box, Material(flat(0.0), None, Emission(3e-6, pattern))))


def test_a_loop_that_cannot_be_recorded_at_first_is_traced():
    scene = glowing()

    def render():
        renderer = SceneRenderer(scene, CAMERA, SETTINGS)
        paths, light = BandPaths(BANDS, 4), []
        for seed in range(3):
            sampler = mi.load_dict({"type": "independent"})
            sampler.seed(seed, 500)
            directions = mi.warp.square_to_uniform_sphere(sampler.next_2d())
            rays, chosen = mi.Ray3f(mi.Point3f(0.1, 0, 0), directions), sampler.next_1d() > 0.2
            light.append(paths.radiance(renderer._loaded, rays, sampler.next_1d(), sampler, chosen))
        return np.array(light)

    recorded, traced = with_and_without(render)
    assert recorded.any()
    np.testing.assert_array_equal(recorded, traced)


def test_whole_paths_with_emitters_are_those_of_traced_loops():
    scene, pose = glowing(), np.diag([1.0, 1, 1, 1])

    def render():
        renderer = SceneRenderer(scene, CAMERA, SETTINGS)
        return [renderer.radiance(pose, seed) for seed in range(3)]

    np.testing.assert_array_equal(*with_and_without(render))


def test_recordings_hold_no_arrays_and_end_with_the_renderer():
    renderer, poses, counts = SceneRenderer(POSTS, CAMERA, FEW), PATH.poses(), []
    loop = renderer._view._integrator._paths._paths._trace
    for frame in range(6):
        renderer.radiance(poses[frame % 3], frame)
        counts.append((dr.whos(as_string=True).count("\n"), loop.n_recordings))
    assert len(set(counts[2:])) == 1  # variables and recordings
    kept = [weakref.ref(renderer._view._integrator), weakref.ref(renderer._whole)]
    gc.disable()
    try:
        del renderer
        assert [each() for each in kept] == [None, None]
    finally:
        gc.enable()


def test_renderers_share_a_scene_at_rest_alone():
    scene, pose = POSTS, PATH.poses()[0]
    large, small = (
        SceneRenderer(scene, CAMERA.model_copy(update={"width": width}), FEW) for width in (24, 16)
    )
    assert large._loaded is small._loaded
    image = small.radiance(pose, 1)
    del large, small
    again = SceneRenderer(scene, CAMERA.model_copy(update={"width": 16}), FEW)
    np.testing.assert_array_equal(again.radiance(pose, 1), image)
    scene = moving.scene(*moving.SPINNING)
    first, second = (SceneRenderer(scene, CAMERA, FEW) for _ in range(2))
    assert first._loaded is not second._loaded
