"""CPU time and error of frames from baked light, against path tracing with as many samples.

Reference: the path tracer on the same scene, in the same run. Its error is the spread over seeds;
that of baked frames is their spread plus their mean difference from path tracing. Equal seeds send
equal primary rays, so that the difference converges much sooner than either image.

Errors are relative to the mean of the image, which the sky dominates: it is about eight times that
of the surfaces. They are no accuracy of the light on surfaces, which is 14 % RMS off with the
demo's settings (median 8 %, one in twenty by more than 28 %), alike in all frames.

Measured in LLVM mode with 32 paths per cell, at 80 px:

    level           mean     pixels   worst band
    daylight        -0.18 %  1.31 %   1.75 %
    twilight        -0.14 %  1.35 %   1.87 %
    full_moon       -0.19 %  1.29 %   1.62 %
    quarter_moon    -0.19 %  1.29 %   1.62 %
    starlight       -0.16 %  1.50 %   1.86 %
    airglow         -0.20 %  1.60 %   2.00 %
    overcast_night  -0.20 %  1.57 %   2.00 %
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from megalopta.config.model import Configuration, load
from megalopta.render import SceneRenderer, frame_seed
from megalopta.scenes.build import build_scene
from megalopta.scenes.lighting.levels import LEVELS


def renderer(configuration: Configuration, integrator: str) -> SceneRenderer:
    scene = build_scene(
        configuration.scene, configuration.light, configuration.camera, configuration.trajectory
    )
    settings = configuration.render.model_copy(update={"integrator": integrator})
    poses = configuration.trajectory.poses()
    return SceneRenderer(scene, configuration.camera, settings, poses)


def cpu_seconds(work: Callable[[], Any]) -> tuple[float, Any]:
    start = time.process_time()
    result = work()
    return time.process_time() - start, result


def images(rendering: SceneRenderer, pose: np.ndarray, seeds: int) -> np.ndarray:
    frames = [rendering.radiance(pose, frame_seed(0, seed)) for seed in range(seeds)]
    return np.array(frames, dtype=np.float64)


def errors(path: np.ndarray, baked: np.ndarray) -> dict[str, float]:
    """Relative errors of stacks (seeds, H, W) of one view."""
    level = path.mean()
    spread = [np.sqrt(stack.var(axis=0, ddof=1).mean()) / level for stack in (path, baked)]
    differences = (baked - path) / level
    noise = differences.var(axis=0, ddof=1).mean() / len(differences)
    bias = np.sqrt(max((differences.mean(axis=0) ** 2).mean() - noise, 0))
    return {
        "path": float(spread[0]),
        "baked": float(np.hypot(spread[1], bias)),
        "difference": float(bias),
        "noise of difference": float(np.sqrt(noise)),
        "mean": float(differences.mean()),
    }


def accuracy(level: str) -> None:
    configuration = load(
        "demo",
        {
            "light.level": level,
            "camera.width": "80",
            "camera.height": "80",
            "trajectory.frames": "100",
        },
    )
    pose = configuration.trajectory.poses()[50]
    path, baked = (images(renderer(configuration, name), pose, 16) for name in ("path", "baked"))
    total = errors(path.sum(axis=-1), baked.sum(axis=-1))
    worst = max(
        errors(path[..., band], baked[..., band])["difference"] for band in range(path.shape[-1])
    )
    print(
        f"  {level:15} mean {total['mean']:+.2%} (required: 0.5 %), "
        f"pixels {total['difference']:.2%}, worst band {worst:.2%} (required: 2 %); "
        f"noise taken off {total['noise of difference']:.2%}",
        flush=True,
    )


def sequence(level: str, frames: int, width: int) -> None:
    configuration = load(
        "demo",
        {
            "light.level": level,
            "camera.width": str(width),
            "camera.height": str(width),
            "render.samples_per_pixel": "16",
            "trajectory.frames": str(frames),
            "trajectory.rotation_deg_s": str(3600 / frames),
            "trajectory.velocity_m_s": "[0.15, 0.05, 0]",
        },
    )
    poses = configuration.trajectory.poses()
    renderer(configuration, "path").radiance(poses[0], 0)  # compiles kernels
    (load_path, path), (load_baked, baked) = (
        cpu_seconds(lambda name=name: renderer(configuration, name)) for name in ("path", "baked")
    )
    few = np.linspace(0, frames - 1, 8).astype(int)
    per_frame = np.mean(
        [cpu_seconds(lambda i=i: path.radiance(poses[i], frame_seed(0, i)))[0] for i in few]
    )
    times = [
        cpu_seconds(lambda i=i: baked.radiance(poses[i], frame_seed(0, i)))[0]
        for i in range(frames)
    ]
    once = load_baked - load_path  # cutting surfaces and the survey
    total_s = once + sum(times)
    pose = poses[frames // 2]
    stacks = [images(each, pose, 16) for each in (path, baked)]
    total = errors(*(stack.sum(axis=-1) for stack in stacks))
    band = errors(*(stack[..., 0] for stack in stacks))
    print(
        f"{level}, {width} px, 16 samples, {frames} frames:\n"
        f"  path   {per_frame * frames:.0f} CPU-s, error of a frame {total['path']:.2%}, "
        f"of its first band {band['path']:.2%}\n"
        f"  baked  {total_s:.0f} CPU-s, error of a frame {total['baked']:.2%}, "
        f"of its first band {band['baked']:.2%}; last frames {np.median(times[-20:]):.3f} s each\n"
        f"  ratio  {total_s / per_frame / frames:.3f} (required: 0.333 at equal error)",
        flush=True,
    )


def main() -> None:
    print("errors are relative to the mean of the image, not to the surfaces, which are darker")
    print("baked against path tracing, difference of converged frames:")
    for level in LEVELS:
        accuracy(level)
    for level in ("twilight", "daylight"):
        sequence(level, 400, 240)


if __name__ == "__main__":
    main()
