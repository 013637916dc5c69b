"""CPU time and error on surfaces of frames from baked light, against path tracing.

Errors are RMS over pixels without sky, relative to their mean. The stated error is that of the
scene record; the true one is against the path tracer on the same scene, in the same run, with many
times the samples. Equal seeds send equal primary rays, so that the difference converges much sooner
than either image.

The table tells, by image size and number of frames, how many rays baking takes for each sample of
all frames, and the ratio of CPU-seconds at equal error: the path tracer's error falls as the root
of its samples. `auto` bakes where that ratio is foreseen to be below a half
(`render/baking/choice.py`, which also holds the cost of a ray in units of another, measured here).
"""

import argparse
import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from megalopta.config.model import Configuration, load
from megalopta.render import RenderNoise, RunningMean, SceneRenderer, frame_seed
from megalopta.render.baking.light import BakedLight
from megalopta.scenes.build import build_scene
from megalopta.scenes.lighting import LEVELS

_REFERENCE = 32


def renderer(configuration: Configuration, integrator: str) -> SceneRenderer:
    scene = build_scene(
        configuration.scene, configuration.light, configuration.camera, configuration.trajectory
    )
    settings = configuration.render.model_copy(update={"integrator": integrator})
    return SceneRenderer(scene, configuration.camera, settings, configuration.trajectory.poses())


def cpu_seconds(work: Callable[[], Any]) -> tuple[float, Any]:
    start = time.process_time()
    result = work()
    return time.process_time() - start, result


def stated(rendering: SceneRenderer, pose: np.ndarray) -> tuple[RenderNoise, np.ndarray]:
    """Stated noise of a frame, and which of its pixels show surfaces alone."""
    passes, measured = RunningMean(), rendering.measured(pose, frame_seed(0, 1))
    for image in (rendering.radiance(pose, frame_seed(0, 0)), measured.radiance):
        passes.add(image)
    return passes.noise(1, measured), measured.sky == 0


def accuracy(preset: str, level: str) -> None:
    """Stated against true error of a baked frame."""
    changes = {
        "scene.preset": preset,
        "light.level": level,
        "camera.width": "80",
        "camera.height": "80",
        "trajectory.frames": "100",
    }
    configuration = load("demo", changes)
    pose = configuration.trajectory.poses()[50]
    path, baked = (renderer(configuration, name) for name in ("path", "baked"))
    noise, part = stated(baked, pose)
    paths, quick = (
        np.array([each.radiance(pose, seed).sum(axis=-1) for seed in range(_REFERENCE)], float)
        for each in (path, baked)
    )
    differences, level_of_light = quick - paths, paths[:, part].mean()
    left = differences.var(axis=0, ddof=1) / _REFERENCE
    standing = (differences.mean(axis=0) ** 2 - left)[part].mean()
    true = math.sqrt(max(standing, 0) + quick.var(axis=0, ddof=1)[part].mean()) / level_of_light
    surface = noise.surface
    assert surface is not None
    print(
        f"  {preset:12} {level:15} stated {surface.rms:.2%}, true {true:.2%}, "
        f"ratio {surface.rms / true:.2f} (required: 0.8 to 1.25); standing: stated "
        f"{surface.standing:.2%}, true {math.sqrt(max(standing, 0)) / level_of_light:.2%} "
        f"(required: 3 %); gradient {surface.gradient:.2%}",
        flush=True,
    )


def sequence(trees: int, frames: int, width: int) -> None:
    """One row of the table."""
    changes = {
        "scene.trees": str(trees),
        "camera.width": str(width),
        "camera.height": str(width),
        "render.samples_per_pixel": "16",
        "trajectory.frames": str(frames),
        "trajectory.rotation_deg_s": str(3600 / frames),
        "trajectory.velocity_m_s": "[0.15, 0.05, 0]",
    }
    configuration = load("demo", changes)
    poses = configuration.trajectory.poses()
    renderer(configuration, "path").radiance(poses[0], 0)  # compiles kernels
    rays = counted_rays()
    (load_path, path), (load_baked, baked) = (
        cpu_seconds(lambda name=name: renderer(configuration, name)) for name in ("path", "baked")
    )
    few = np.linspace(0, frames - 1, 8).astype(int)
    of_path, of_baked = (
        np.mean([cpu_seconds(lambda i=i, each=each: each.radiance(poses[i], i))[0] for i in few])
        for each in (path, baked)
    )
    errors = []
    for each in (path, baked):
        surface = stated(each, poses[frames // 2])[0].surface
        assert surface is not None
        errors.append(surface.rms)
    ratio = (load_baked - load_path + of_baked * frames) / (
        of_path * frames * (errors[0] / errors[1]) ** 2
    )
    samples = frames * width**2 * 16
    print(
        f"  {trees:5} trees, {width} px, {frames:3} frames: {sum(rays) / samples:5.1f} rays per "
        f"sample; CPU-s of a frame {of_path:.2f} traced, {of_baked:.2f} baked, bake "
        f"{load_baked - load_path:.0f}; error {errors[0]:.1%} and {errors[1]:.1%}; "
        f"ratio at equal error {ratio:.2f}",
        flush=True,
    )


def counted_rays() -> list[int]:
    """A list that grows with the rays of every bake from now on."""
    rays: list[int] = []
    bake_all = BakedLight.bake_all

    def counting(light: BakedLight) -> None:
        rays.append(light.total_rays())
        bake_all(light)

    BakedLight.bake_all = counting  # type: ignore[method-assign]
    return rays


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trees", type=int, default=1000)
    trees = parser.parse_args().trees
    print("stated and true error of baked frames, on surfaces:")
    for preset in ("open", "clearing", "understorey", "dense"):
        for level in LEVELS:
            accuracy(preset, level)
    print("cost by image size and frames (required: ratio 0.5 at 251 px, 100 frames):")
    for width in (120, 180, 251):
        for frames in (10, 30, 100, 400):
            sequence(trees, frames, width)


if __name__ == "__main__":
    main()
