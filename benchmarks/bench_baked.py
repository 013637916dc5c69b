"""CPU time and error on surfaces of frames from baked light, against path tracing.

Errors are RMS over pixels without sky, relative to their mean. The stated error is that of the
scene record; the true one is against the path tracer on the same scene, in the same run, with many
times the samples. Equal seeds send equal primary rays, so that the difference converges much sooner
than either image.

The table tells, by image size, number of frames and error, how many rays a pixel baking takes, and
the ratio of CPU-seconds at equal error, extrapolated from costs and variances of two frames: errors
fall as the root of samples. `auto` bakes where that ratio is foreseen to be below a half
(`render/baking/choice.py`, which also holds the cost of a ray in units of another, measured here).
"""

import argparse
import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

import numpy as np

from megalopta.config.model import Configuration, load
from megalopta.render import RenderNoise, RunningMean, SceneRenderer, frame_seed
from megalopta.render.baking.gathering import Gatherer
from megalopta.render.baking.light import BakedLight
from megalopta.scenes.build import build_scene
from megalopta.scenes.lighting.levels import LEVELS

_REFERENCE = 32
_SAMPLES, _BAKE_ERROR = 196, 0.1
"""Of the frames from which costs and variances are taken: fewer samples take pixels with little sky
for surfaces, and their error is that of leaves against it, traced and baked alike."""


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


def forest(trees: int, frames: int, width: int) -> Configuration:
    """A sequence past trees, of a camera that turns as far in any number of frames."""
    changes = {
        "scene.trees": str(trees),
        "camera.width": str(width),
        "camera.height": str(width),
        "render.samples_per_pixel": str(_SAMPLES),
        "render.bake_error": str(_BAKE_ERROR),
        "trajectory.frames": str(frames),
        "trajectory.rotation_deg_s": str(3600 / frames),
        "trajectory.velocity_m_s": "[0.15, 0.05, 0]",
    }
    return load("demo", changes)


def costs(trees: int, width: int, lengths: Sequence[int]) -> None:
    """Rows of the table, of one image size."""
    configuration = forest(trees, lengths[0], width)
    poses = configuration.trajectory.poses()
    few = [poses[round(place * (lengths[0] - 1))] for place in (0.3, 0.7)]
    pixels = width**2
    with unbaked() as bakes:
        path, baked = (renderer(configuration, name) for name in ("path", "baked"))
        spent, variance = [], []
        for each in (path, baked):
            variance.append(np.mean([sample_variance(each, pose) for pose in few]))
            work = [cpu_seconds(lambda e=each, p=pose: e.radiance(p, 1))[0] for pose in few]
            spent.append(np.mean(work) / pixels / _SAMPLES)
        ray = bakes[-1].cpu_s / bakes[-1].rays
        print(
            f"  {trees} trees, {width} px: a sample takes {1e6 * spent[0]:.2f} CPU-us traced, "
            f"{1e6 * spent[1]:.2f} baked, a ray of the bake {1e6 * ray:.2f}; variance of a sample "
            f"of {_SAMPLES}, over the mean², {variance[0]:.2f} and {variance[1]:.2f}",
            flush=True,
        )
        for frames in lengths:
            configuration = forest(trees, frames, width)
            load_path = cpu_seconds(lambda c=configuration: renderer(c, "path"))[0]
            survey = cpu_seconds(lambda c=configuration: renderer(c, "baked"))[0] - load_path
            for error in (0.1, 0.05, 0.03):
                samples = frames * pixels / error**2
                rays = bakes[-1].rays_for(error / 2)
                traced = samples * variance[0] * spent[0]
                # Half of the error stands, and the samples have the rest.
                quick = survey + ray * rays + samples / 0.75 * variance[1] * spent[1]
                print(
                    f"    {frames:3} frames, error {error:4.0%}: {rays / pixels:.0f} rays per pixel"
                    f"; CPU-s {traced:.0f} traced, {quick:.0f} baked, ratio {quick / traced:.2f}",
                    flush=True,
                )


def sample_variance(rendering: SceneRenderer, pose: np.ndarray) -> float:
    """Variance of one sample on surfaces over their mean squared, without what stands."""
    surface = stated(rendering, pose)[0].surface
    assert surface is not None
    return (surface.rms**2 - surface.standing**2) * _SAMPLES


class Bake:
    """Rays of a sequence's baked light, and what those cost that frames asked for."""

    def __init__(self, light: BakedLight) -> None:
        self._light, self._density = light, light.density
        self.rays, self.cpu_s = 0, 0.0

    def rays_for(self, error: float) -> int:
        """Rays of the whole bake for a standing error; what was baked is lost."""
        self._light.begin(self._density)
        self._light.begin(self._light.density_for(error / _BAKE_ERROR))
        return self._light.total_rays()


@contextmanager
def unbaked() -> Iterator[list[Bake]]:
    """Bakes that compute nothing but what frames meet, and count it."""
    bakes: list[Bake] = []
    leaving = Gatherer.leaving

    def counted(gatherer: Gatherer, *cells: Any, shares: Any, least: int) -> Any:
        spent, found = cpu_seconds(lambda: leaving(gatherer, *cells, shares=shares, least=least))
        if bakes:
            bakes[-1].cpu_s += spent
            bakes[-1].rays += 2 * least * int(shares.sum())
        return found

    with (
        patch.object(BakedLight, "bake_all", lambda light: bakes.append(Bake(light))),
        patch.object(BakedLight, "contents", lambda _light: {}),
        patch.object(Gatherer, "leaving", counted),
    ):
        yield bakes


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
        costs(trees, width, (100, 10, 30, 400))


if __name__ == "__main__":
    main()
