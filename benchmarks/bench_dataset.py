"""What a dataset of many sequences costs.

Overhead: a forest sequence is made by one core, as a worker has it, while the baking of light, ray
tracing, truth rays and the drawing of photons are timed; whatever else the wall clock saw is
overhead (required: below 10 %): growing and loading the forest, reading, writing, hashing,
statistics, the index. Its plants are in the cache, as of all sequences after the first few.

Workers: the same sequences are made by one worker on one core and by two workers on two, in scalar
mode, where a sequence uses no more cores than its worker has (required: 1.7 times the frames). Each
run is timed from the first sequence of each worker to the last one, without the start of processes.

Memory: peak of a process that makes few and many sequences, short and long ones (required: equal
within 5 %). Everything runs in a temporary folder, with a cache of its own; 6 minutes on an
idle machine.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

from megalopta.config.recipe import Plan
from megalopta.dataset.store import Tree
from megalopta.stages.make import make

OVERHEAD_REQUIRED, GAIN_REQUIRED, GROWTH_ALLOWED = 0.10, 1.7, 0.05
_TRACED = "baked light", "ray tracing", "truth rays", "photon drawing"
SENSORS: dict[str, Any] = {"sensors": ("spadcam", "ideal"), "light_levels": ("twilight",)}
FOREST = Plan(
    sequences=1,
    scenes=("demo",),
    every={
        "camera": {"width": 120, "height": 120},
        "trajectory": {"frames": 20},
        "correct": False,  # calibration would be photon drawing, and flatter the rest
    },
    **SENSORS,
)
BOARDS = Plan(
    sequences=10,
    scenes=("grating",),
    every={
        "camera": {"width": 48, "height": 36},
        "trajectory": {"frames": 8},
        "render": {"samples_per_pixel": 16, "integrator": "path"},
    },
    **SENSORS,
)
CASES = {"few, short": (2, 4), "many": (12, 4), "long": (2, 24)}
"""Sequences and frames whose peaks of memory are compared."""


def boards(sequences: int, frames: int) -> Plan:
    """Small ones."""
    every = {
        "camera": {"width": 64, "height": 48},
        "trajectory": {"frames": frames},
        "render": {"samples_per_pixel": 1, "integrator": "path"},
    }
    return Plan(sequences=sequences, scenes=("grating",), every=every, **SENSORS)


class Clock:
    """Seconds by what they went to; what is called within a timed call counts to the outer one."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self._busy = False

    def timed(self, what: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def wrapped(*args: Any, **named: Any) -> Any:
            if self._busy:
                return call(*args, **named)
            start, self._busy = time.perf_counter(), True
            try:
                return call(*args, **named)
            finally:
                self._busy = False
                self.seconds[what] += time.perf_counter() - start

        return wrapped


def overhead(folder: Path) -> dict[str, Any]:
    """Seconds of one forest sequence by what they went to, and bytes by product."""
    from megalopta.render import SceneRenderer
    from megalopta.render.baking.integrator import BakedLightIntegrator
    from megalopta.sensor.shot import Shot

    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:1])
    quick = {**FOREST.every, "render": {"samples_per_pixel": 1}}
    make(folder.with_name("quick"), FOREST.model_copy(update={"every": quick}))  # fills the cache
    clock = Clock()
    for name in ("radiance", "measured", "light_survey"):
        setattr(SceneRenderer, name, clock.timed("ray tracing", getattr(SceneRenderer, name)))
    baked = clock.timed("baked light", BakedLightIntegrator.__init__)
    BakedLightIntegrator.__init__ = baked  # type: ignore[method-assign]
    SceneRenderer.truth = clock.timed("truth rays", SceneRenderer.truth)  # type: ignore[method-assign]
    Shot.readings = clock.timed("photon drawing", Shot.readings)  # type: ignore[method-assign]
    start, cpu = time.perf_counter(), time.process_time()
    tree = make(folder, FOREST)
    total, cpu = time.perf_counter() - start, time.process_time() - cpu
    return {"total": total, "cpu": cpu, **clock.seconds, "bytes": bytes_by_product(tree)}


def bytes_by_product(tree: Tree) -> dict[str, float]:
    """Bytes a frame."""
    record = tree.record(tree.names()[0])
    sizes: dict[str, float] = defaultdict(float)
    for path, (size, _) in record.files.items():
        parts = Path(path).parts
        product = "/".join(parts[: 2 if parts[0] == "training" else 1])
        sizes[product] += size / FOREST.every["trajectory"]["frames"]
    for path in (tree.record_path(record.sequence), *(tree.root / "index").glob("*")):
        sizes["records and index"] += path.stat().st_size / FOREST.every["trajectory"]["frames"]
    return dict(sizes)


def rate(folder: Path, workers: int) -> dict[str, Any]:
    """Frames per hour between the first sequence of every worker and the last one."""
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:workers])  # of its children, too
    tree = make(folder, BOARDS, workers=workers)
    ends = sorted(tree.record_path(name).stat().st_mtime for name in tree.names())
    frames = (len(ends) - workers) * BOARDS.every["trajectory"]["frames"]
    return {"frames_per_hour": 3600 * frames / (ends[-1] - ends[workers - 1])}


def peak(folder: Path, sequences: int, frames: int) -> dict[str, Any]:
    """Largest resident memory (MB) of this process."""
    make(folder, boards(sequences, frames))
    return {"mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024}


def measured(cache: Path, *part: str, scalar: bool = False) -> dict[str, Any]:
    """What a part of this script finds, in a process of its own."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache)}
    if scalar:
        environment["DRJIT_LIBLLVM_PATH"] = "/none"
    done = subprocess.run(
        [sys.executable, __file__, *part], env=environment, stdout=subprocess.PIPE, check=True
    )
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def run_part(name: str, *numbers: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        part = {"overhead": overhead, "rate": rate, "peak": peak}[name]
        print(json.dumps(part(Path(folder) / "data", *map(int, numbers))))


def show_costs(costs: dict[str, Any]) -> None:
    """Print shares of the time, and bytes a frame."""
    parts = {name: costs[name] for name in _TRACED}
    rest = costs["total"] - sum(parts.values())
    share = rest / costs["total"]
    for name, seconds in {**parts, "everything else": rest}.items():
        print(f"  {name:16} {seconds:7.2f} s  {seconds / costs['total']:6.1%}")
    print(
        f"  overhead {share:.1%}, {costs['cpu']:.1f} CPU-s in all (required: below "
        f"{OVERHEAD_REQUIRED:.0%})"
    )
    print("bytes a frame by product:")
    for name, size in sorted(costs["bytes"].items(), key=lambda each: -each[1]):
        print(f"  {name:24} {size / 1e3:9.1f} kB")


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        cache = Path(folder)
        print("a forest sequence:", flush=True)
        costs = measured(cache, "overhead")
        show_costs(costs)
        peaks = {
            name: measured(cache, "peak", *map(str, case))["mb"] for name, case in CASES.items()
        }
        largest, first = max(peaks.values()), next(iter(peaks.values()))
        for name, (sequences, frames) in CASES.items():
            print(f"memory, {sequences} sequences of {frames} frames: {peaks[name]:.0f} MB")
        print(f"  growth {largest / first - 1:.1%} (allowed: {GROWTH_ALLOWED:.0%})", flush=True)
        rates = [
            measured(cache, "rate", str(workers), scalar=True)["frames_per_hour"]
            for workers in (1, 2)
        ]
        gain = rates[1] / rates[0]
        print(
            f"scalar mode, a core a worker: {rates[0]:,.0f} frames per hour by 1 worker, "
            f"{rates[1]:,.0f} by 2: {gain:.2f} times (required: {GAIN_REQUIRED:g})"
        )


if __name__ == "__main__":
    run_part(*sys.argv[1:]) if len(sys.argv) > 1 else main()
