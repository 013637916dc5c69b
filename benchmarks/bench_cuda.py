"""Light and truth of a CUDA device, beside those of LLVM on the processor's cores, in one run.

For each scene: agreement of single pixels (both draw the same random numbers), of the mean of each
band, in standard errors of the noise, and of the truth; seconds of a frame, after a first one that
compiles, and of baking. `python benchmarks/bench_cuda.py [SCENE ...]`.
"""

import sys
import time
import traceback
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from megalopta.config.model import Configuration, load
from megalopta.render.scene_renderer import SceneRenderer
from megalopta.scenes.build import build_scene

SIZE = {"camera.width": "640", "camera.height": "480", "trajectory.frames": "3"}
SMALL = {"camera.width": "160", "camera.height": "120"}
SCENES: dict[str, tuple[str, dict[str, str]]] = {
    "demo, by day": ("demo", {"render.integrator": "path"}),
    "demo, starlight": ("demo", {"render.integrator": "path", "light.level": "starlight"}),
    "dense": ("demo", {"scene.preset": "dense", "render.integrator": "path"}),
    "rain forest": ("demo", {"scene.preset": "rainforest", "render.integrator": "path"}),
    "haze": ("demo", {**SMALL, "render.integrator": "path", "scene.haze.visibility_m": "50"}),
    "airglow": ("airglow", {}),
    "baked, by day": ("demo", {**SMALL, "render.integrator": "baked", "render.bake_error": "0.1"}),
}


class Answer(NamedTuple):
    """Two frames of light of different seeds, the truth of the sequence, and seconds of each."""

    frames: np.ndarray
    truth: Any
    build_s: float
    first_s: float
    frame_s: float
    truth_s: float


def seconds(work: Callable[[], Any]) -> tuple[Any, float]:
    start = time.perf_counter()
    return work(), time.perf_counter() - start


def answer(configuration: Configuration, backend: str) -> Answer:
    settings = configuration.render.model_copy(
        update={"backend": backend, "samples_per_pass": 2**24}
    )
    camera, path = configuration.camera, configuration.trajectory
    poses = path.poses()

    def build() -> SceneRenderer:
        scene = build_scene(configuration.scene, configuration.light, camera, path)
        return SceneRenderer(scene, camera, settings, poses, configuration.seed)

    renderer, build_s = seconds(build)
    one, first_s = seconds(lambda: renderer.radiance(poses[1], 1))
    two, frame_s = seconds(lambda: renderer.radiance(poses[1], 2))
    renderer.truth(poses, 1, path.times_s)
    truth, truth_s = seconds(lambda: renderer.truth(poses, 1, path.times_s))
    print(f"  {backend}: {renderer.integrator}", flush=True)
    return Answer(np.stack([one, two]), truth, build_s, first_s, frame_s, truth_s)


def report(name: str, cuda: Answer, llvm: Answer) -> None:
    same = cuda.truth.object_id == llvm.truth.object_id
    flow = np.abs(cuda.truth.flow_forward - llvm.truth.flow_forward)[same]
    pixels = np.isclose(cuda.frames, llvm.frames, rtol=1e-3, atol=0).mean()
    samples = cuda.frames[..., 0].size
    noise = np.std(np.diff(cuda.frames, axis=0)[0] / np.sqrt(2), axis=(0, 1)) / np.sqrt(samples)
    here, there = (each.frames.astype(float).mean(axis=(0, 1, 2)) for each in (cuda, llvm))
    print(
        f"{name}: ids the same {same.mean():.5f}, flow 99.9 % within "
        f"{np.nanpercentile(flow, 99.9):.1e} px; light within 1e-3 at {pixels:.4f} of the pixels, "
        f"means of bands {np.round(here / there - 1, 5)} away, "
        f"{np.round((here - there) / noise, 2)} standard errors"
    )
    for label, each in (("cuda", cuda), ("llvm", llvm)):
        print(
            f"  {label}: loaded and baked {each.build_s:.2f} s, first frame {each.first_s:.2f} s, "
            f"frame {each.frame_s:.3f} s, truth {each.truth_s:.3f} s",
            flush=True,
        )


def main() -> None:
    for name in sys.argv[1:] or SCENES:
        preset, overrides = SCENES[name]
        try:
            configuration = load(preset, {**SIZE, **overrides})
            report(name, *(answer(configuration, backend) for backend in ("cuda", "llvm")))
        except Exception:  # the other scenes are still compared
            traceback.print_exc()


if __name__ == "__main__":
    main()
