"""How much of the render stage is Mitsuba, and whether time and memory stay flat over 200 frames.

Reference: the time inside Mitsuba's own calls (path tracing and the tracing of rays, with the
evaluation they leave pending), measured in the same run as the stage around them.
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

from megalopta.configuration import load
from megalopta.dataset import begin_stage
from megalopta.render import rays, renderer
from megalopta.stage_render import FrameWriter

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
        dataset = begin_stage(Path(folder) / "data", configuration, "render")
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
        f"  share inside Mitsuba   {inside / sum(times):.1%} (required: 85 %)\n"
        f"  seconds per frame      {statistics.median(times):.3f} median\n"
        f"  last / first quarter   {last / first:.3f} in time, "
        f"{np.median(memory[-quarter:]) / np.median(memory[:quarter]):.3f} in resident memory"
    )


def main() -> None:
    renderer.trace_paths = timed(renderer.trace_paths)
    for name in ("intersect", "blocked"):
        setattr(rays, name, timed(getattr(rays, name)))
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
