"""How much of the render stage is Mitsuba, whether time and memory stay flat, what panoramas cost.

Required: what is not Mitsuba is at most 5 % of the stage. Its reference: the time inside Mitsuba's
own calls (path tracing and the tracing of rays, with the evaluation they leave pending), measured
in the same run as the stage around them. Of the panoramas: a pinhole in the same forest, frame by
frame in turn.
"""

import resource
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from megalopta.config.model import load
from megalopta.dataset.store import Dataset
from megalopta.render.loading.scene import SceneRays
from megalopta.render.path_tracing import PathIntegrator
from megalopta.render.scene_renderer import SceneRenderer
from megalopta.render.settings import RenderSettings
from megalopta.scenes.build import build_scene
from megalopta.scenes.cameras.panoramic import EquirectangularCamera
from megalopta.scenes.cameras.perspective import PerspectiveCamera
from megalopta.scenes.forest.description import Forest
from megalopta.scenes.forest.sway import Wind
from megalopta.scenes.light import Light
from megalopta.scenes.motion import Drift
from megalopta.scenes.moving_objects import MovingObject
from megalopta.scenes.trajectories.steady import Trajectory
from megalopta.stages.render import FrameWriter

inside = 0.0


def timed(function: Callable[..., Any]) -> Callable[..., Any]:
    def wrapper(*args: Any, **kwargs: Any) -> Any:
        global inside
        start = time.perf_counter()
        result = function(*args, **kwargs)
        if not mi.variant().startswith("scalar"):
            dr.eval(result)
            dr.sync_thread()
        inside += time.perf_counter() - start
        return result

    return wrapper


def resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def run(frames: int, overrides: dict[str, str]) -> None:
    global inside
    fixed = {"trajectory.frames": str(frames), "render.integrator": "path"}
    configuration = load("demo", {**fixed, **overrides})
    with tempfile.TemporaryDirectory() as folder:
        dataset = Dataset(Path(folder) / "data", configuration)
        writer = FrameWriter(dataset)
        times, memory = [], []
        for index in range(frames):
            if index == 2:  # kernels are compiled and caches warm
                inside = 0.0
            start = time.perf_counter()
            writer.write(index)
            times.append(time.perf_counter() - start)
            memory.append(resident_mb())
    times, memory = times[2:], memory[2:]
    quarter = len(times) // 4
    first, last = (statistics.median(part) for part in (times[:quarter], times[-quarter:]))
    print(
        f"{mi.variant()}, {configuration.camera.width} px, "
        f"{configuration.render.samples_per_pixel} samples, {frames} frames:\n"
        f"  share inside Mitsuba   {inside / sum(times):.1%} (required: 95 %)\n"
        f"  seconds per frame      {statistics.median(times):.3f} median\n"
        f"  last / first quarter   {last / first:.3f} in time, "
        f"{np.median(memory[-quarter:]) / np.median(memory[:quarter]):.3f} in resident memory"
    )


def compare_cameras(frames: int) -> None:
    configuration = load("demo")
    same_field = {"width": 240, "height": 240, "fov_deg": 75}
    cameras = {
        "perspective, 75°": PerspectiveCamera(**same_field),
        "equirectangular, 75°": EquirectangularCamera(**same_field, lower_deg=-37, upper_deg=37),
        "equirectangular, all around": EquirectangularCamera(width=340, height=170),
    }
    scene = build_scene(
        configuration.scene, configuration.light, configuration.camera, configuration.trajectory
    )
    renderers = {
        name: SceneRenderer(scene, camera, configuration.render) for name, camera in cameras.items()
    }
    pose = configuration.trajectory.poses()[0]
    seconds: dict[str, list[float]] = {name: [] for name in cameras}
    for seed in range(frames + 1):  # kernels are compiled in the first
        for name, each in renderers.items():
            start = time.process_time()
            each.radiance(pose, seed)
            seconds[name].append(time.process_time() - start)
    speeds = {
        name: camera.width
        * camera.height
        * renderers[name].samples_per_pixel
        / statistics.median(seconds[name][1:])
        for name, camera in cameras.items()
    }
    reference = next(iter(speeds.values()))
    print(f"{mi.variant()}, samples per CPU-second, {frames} frames each in turn:")
    for name, speed in speeds.items():
        print(f"  {name:<29}{speed / 1e6:.3f} million, {speed / reference:.2f} of the pinhole's")


def compare_truth(frames: int) -> None:
    """Print what the truth of a frame costs, in path-traced frames of 8 samples per pixel."""
    camera = PerspectiveCamera(width=251, height=251, fov_deg=100)
    path = Trajectory(frames=frames + 3, rotation_deg_s=12, velocity_m_s=(1.0, 0.3, 0.0))
    times = path.times_s
    crate = MovingObject(motion=Drift(velocity_m_s=(0, 1, 0), spin_deg_s=90))
    scenes = {
        "at rest": (Forest(), ()),
        "with one moving object": (Forest(), (crate,)),
        "swaying": (Forest(wind=Wind()), ()),
    }
    settings = RenderSettings(samples_per_pixel=8, integrator="path")
    print(f"truth of a 150-tree forest, 251 px, {frames} frames (required: 100 %):")
    for name, (forest, objects) in scenes.items():
        scene = build_scene(forest, Light(), camera, path, objects)
        renderer = SceneRenderer(scene, camera, settings)
        costs = []
        for frame in range(1, frames + 2):  # kernels are compiled in the first
            start = time.process_time()
            renderer.radiance(path.poses()[frame], frame, times[frame])
            middle = time.process_time()
            renderer.truth(path.poses(), frame, times)
            costs.append((middle - start, time.process_time() - middle))
        image, truth = np.median(costs[1:], axis=0)
        print(f"  {name:<24}{truth:.2f} of {image:.2f} CPU-seconds, {truth / image:.0%}")


def main() -> None:
    compare_truth(4)
    compare_cameras(5)
    PathIntegrator.render = timed(PathIntegrator.render)  # type: ignore[method-assign]
    for name in ("nearest", "is_hidden"):
        setattr(SceneRays, name, timed(getattr(SceneRays, name)))
    run(24, {})
    # A camera that stands still: every frame is the same work.
    run(
        200,
        {
            "camera.width": "48",
            "camera.height": "48",
            "render.samples_per_pixel": "9",
            "trajectory.rotation_deg_s": "0",
            "trajectory.velocity_m_s": "[0, 0, 0]",
            "benchmark.sizes": "[40]",
        },
    )


if __name__ == "__main__":
    main()
