"""The stated error of frames of whole forests, against many times the samples."""

import math

import numpy as np
import pytest

from megalopta.render import RenderSettings, RunningMean, SceneRenderer, choose_variant
from megalopta.scenes import Light, PerspectiveCamera, Trajectory, build_scene
from megalopta.scenes.forest import Forest

PRESETS = ("open", "clearing", "understorey", "dense")
LEVELS = ("daylight", "twilight", "full_moon", "starlight", "airglow")
CAMERA = PerspectiveCamera(width=32, height=32, fov_deg=75)
PATH = Trajectory(frames=8, velocity_m_s=(1.0, 0.3, 0.0), rotation_deg_s=12)
REFERENCE = 48


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["path", "baked"])
@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("preset", PRESETS)
def test_frames_of_forests_lie_within_their_stated_error(preset, level, integrator):
    if integrator == "baked" and choose_variant().name.startswith("scalar"):
        pytest.skip("baking needs a vectorized variant")
    forest = Forest(preset=preset, seed=PRESETS.index(preset), trees=40)
    scene = build_scene(forest, Light(level=level), CAMERA, PATH)
    poses = PATH.poses()
    settings = RenderSettings(samples_per_pixel=25, max_depth=3, bake_error=0.03)
    tracer, frames = (
        SceneRenderer(scene, CAMERA, settings.model_copy(update={"integrator": name}), poses)
        for name in ("path", integrator)
    )
    passes, measured = RunningMean(), frames.measured(poses[4], 1)
    for image in (frames.radiance(poses[4], 0), measured.radiance):
        passes.add(image)
    stated = passes.noise(1, measured).surface
    part = measured.sky == 0
    # Equal seeds send equal primary rays: what baked frames differ by is known soon.
    paths, others = (
        np.array([each.radiance(poses[4], 2 + seed).sum(axis=-1) for seed in range(REFERENCE)])
        for each in (tracer, frames)
    )
    differences = others.astype(float) - paths
    noise = differences.var(axis=0, ddof=1) / REFERENCE
    standing = np.mean((differences.mean(axis=0) ** 2 - noise)[part])
    flicker = others.var(axis=0, ddof=1, dtype=float)[part].mean()
    level_of_light = paths.mean(axis=0)[part].mean()
    true = math.sqrt(max(standing, 0) + flicker) / level_of_light
    assert 0.8 < stated.rms / true < 1.25
