"""The stated error of frames of whole forests and of gloss, against many times the samples.

`MEGALOPTA_LONG=1` takes every forest in every light.
"""

import dataclasses
import math
import os
from functools import cache

import numpy as np
import pytest
import trimesh

from megalopta.render import RenderSettings, RunningMean, SceneRenderer, choose_variant, mi
from megalopta.render.film import Film
from megalopta.scenes import Forest, Light, Meshes, PerspectiveCamera, Trajectory, build_scene

from ..scenes.meshes.files import Gltf

PRESETS = ("open", "clearing", "understorey", "dense")
LEVELS = ("daylight", "twilight", "full_moon", "starlight", "airglow")
CAMERA = PerspectiveCamera(width=32, height=32, fov_deg=75)
PATH = Trajectory(frames=8, velocity_m_s=(1.0, 0.3, 0.0), rotation_deg_s=12)
POSE = PATH.poses()[4]
REFERENCE, STATED = 48, 12
BAKE_ERROR = 0.04
"""Baked light of a dense forest takes four times as long at the default of 0.022."""
IS_LONG = os.environ.get("MEGALOPTA_LONG") == "1"
CASES = [
    (preset, level)
    for place, preset in enumerate(PRESETS)
    for level in (LEVELS if IS_LONG else LEVELS[place : place + 1])
]


@cache
def forest(preset):
    """A small forest; every level lights the same."""
    scene = Forest(preset=preset, seed=PRESETS.index(preset), trees=80)
    return build_scene(scene, Light(), CAMERA, PATH)


def renderer(scene, integrator):
    settings = RenderSettings(
        samples_per_pixel=25, max_depth=3, integrator=integrator, bake_error=BAKE_ERROR
    )
    return SceneRenderer(scene, CAMERA, settings, PATH.poses())


def stated(rendering):
    """Error of surfaces, from more passes than of a sequence, and which pixels show them."""
    passes, measured = RunningMean(), rendering.measured(POSE, 1000)
    passes.add(measured.radiance)
    for number in range(1, STATED):
        passes.add(rendering.radiance(POSE, 1000 + number))
    return passes.noise(1, measured).surface, measured.sky == 0


@pytest.mark.slow
@pytest.mark.parametrize(("preset", "level"), CASES)
def test_frames_of_forests_lie_within_their_stated_error(preset, level):
    if choose_variant().name.startswith("scalar"):
        pytest.skip("baking needs a vectorized variant")
    scene = dataclasses.replace(forest(preset), lighting=Light(level=level).lighting())
    tracer, baked = (renderer(scene, name) for name in ("path", "baked"))
    # Equal seeds send equal primary rays: what baked frames differ by is known soon.
    paths, others = (
        np.array([each.radiance(POSE, seed).sum(axis=-1) for seed in range(REFERENCE)], float)
        for each in (tracer, baked)
    )
    differences = others - paths
    noise = differences.var(axis=0, ddof=1) / REFERENCE
    standing = differences.mean(axis=0) ** 2 - noise
    for rendering, frames, off in (
        (tracer, paths, np.zeros_like(noise)),
        (baked, others, standing),
    ):
        surface, part = stated(rendering)
        level_of_light = paths.mean(axis=0)[part].mean()
        left = max(off[part].mean(), 0.0)
        true = math.sqrt(left + frames.var(axis=0, ddof=1)[part].mean()) / level_of_light
        print(f"{preset} {level} {rendering.integrator}: stated over true {surface.rms / true:.3f}")
        assert 0.8 < surface.rms / true < 1.25


GLASS = {"KHR_materials_transmission": {"transmissionFactor": 1}}
GLOSS = {
    "metal": {"pbrMetallicRoughness": {"roughnessFactor": 0.3}},
    "clearcoat": {
        "pbrMetallicRoughness": {"baseColorFactor": [0.6, 0.1, 0.1, 1], "metallicFactor": 0},
        "extensions": {"KHR_materials_clearcoat": {"clearcoatFactor": 1}},
    },
    "glass": {
        "pbrMetallicRoughness": {"roughnessFactor": 0.3, "metallicFactor": 0},
        "extensions": {**GLASS, "KHR_materials_volume": {"thicknessFactor": 1}},
    },
}


@pytest.mark.slow
@pytest.mark.parametrize("name", GLOSS)
def test_frames_of_gloss_lie_within_their_stated_error(tmp_path, name):
    if choose_variant().name.startswith("scalar"):
        pytest.skip("scalar variants are Mitsuba's own")
    file, ball = Gltf(), trimesh.creation.icosphere(3)
    vertices = ball.vertices.astype(np.float32)
    file.triangle(vertices, 0, ball.faces, NORMAL=file.accessor(vertices))
    file.header["materials"] = [GLOSS[name]]
    (tmp_path / "ball.glb").write_bytes(file.glb())
    path = Trajectory(frames=2, position_m=(-4, 0, 2), look_at_m=(0, 0, -0.3))
    scene = build_scene(
        Meshes(files=str(tmp_path / "ball.glb"), ground=0.4), Light(level="daylight"), CAMERA, path
    )
    settings = RenderSettings(samples_per_pixel=64)
    rendering = SceneRenderer(scene, CAMERA, settings, path.poses())
    pose = path.poses()[0]
    passes = [rendering.measured(pose, seed) for seed in range(32)]
    part, frames = passes[0].sky == 0, np.array([each.radiance for each in passes], float)
    two = []
    for first, second in zip(passes[::2], passes[1::2], strict=True):
        both = RunningMean()
        both.add(first.radiance)
        both.add(second.radiance)
        two.append(both.noise(1, second).surface.rms)
    # Mitsuba's own paths, with 128 times the samples.
    film, theirs = Film(CAMERA, settings, 256), mi.load_dict({"type": "path", "max_depth": 16})

    def trace(loaded, sensor, seed, spp):
        return np.array(theirs.render(loaded, sensor, seed=seed, spp=spp), np.float32)

    loaded, local = rendering._loaded, rendering._local(pose)
    references = np.array([film.expose(trace, loaded, local, seed) for seed in range(32)], float)
    reference = references.mean(axis=0)
    level = reference[part].sum(axis=-1).mean()
    errors = np.sqrt(((frames - reference).sum(axis=-1) ** 2)[:, part].mean(axis=1)) / level
    of_all = [np.sqrt(np.mean(np.square(values))) for values in (two, errors)]
    print(f"{name}: stated {of_all[0]:.4f} ({min(two):.4f} to {max(two):.4f}), true "
          f"{of_all[1]:.4f} ({min(errors):.4f} to {max(errors):.4f}), mean of light "
          f"{frames[:, part].sum(axis=-1).mean() / level:.4f}")  # fmt: skip
    assert 0.8 < of_all[0] / of_all[1] < 1.25
