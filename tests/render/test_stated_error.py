"""The stated error of frames of whole forests, against many times the samples.

`MEGALOPTA_LONG=1` takes every forest in every light.
"""

import dataclasses
import math
import os
from functools import cache

import numpy as np
import pytest

from megalopta.render import RenderSettings, RunningMean, SceneRenderer, choose_variant
from megalopta.scenes import Forest, Light, PerspectiveCamera, Trajectory, build_scene

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
