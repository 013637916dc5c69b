"""Estimate the cost of a plan, or of one sequence, from small frames of at most three sequences.

A strip of two frames is rendered and exposed, as wide as the image, with as many rows as take a
second or two. The first compiles and bakes; what the second takes is multiplied by the pixels and
frames of the sequences that it stands for. The result is good to a factor of two. Where `auto` may
bake, the strip is baked, and the time is an upper bound: light is baked only if that takes less
work.
"""

import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from megalopta.config.drawing import configuration_of
from megalopta.config.model import Configuration
from megalopta.config.recipe import Plan
from megalopta.core.progress import duration, say, silent, step, times_of_steps
from megalopta.dataset.store import Dataset, files_in
from megalopta.generation.jobs import threads_of, use_threads
from megalopta.generation.making import write_flow_files
from megalopta.render.baking.choice import may_pay
from megalopta.stages.limits import needed_bytes, size
from megalopta.stages.pipeline import check_stage
from megalopta.stages.registry import STAGES
from megalopta.stages.render import FrameWriter, write_previews

_DRAWN = 200
"""Most sequences of a plan that are drawn"""
_MEASURED = 3
_FEWEST_ROWS, _PIXELS, _PATHS, _BAKED_PIXELS = 8, 8192, 60_000, 256
_CLOSING_PATHS = 200_000
"""Light paths that measure the light on the ground and the truncation bias"""

Cost = NDArray[np.float64]
"""Wall-clock time and processor time (s), and bytes on disk, (3,)."""
Finish = Callable[[Dataset], None]
"""Work after the rendering of a dataset's frames, such as sensors."""


def dry_run(root: Path, plan: Plan, workers: int = 1, only: Sequence[int] | None = None) -> None:
    """Print the estimated cost of a plan, without making anything.

    The time is that of this machine, with as many parallel sequences as there are workers, each
    with its share of the cores.
    """
    use_threads(threads_of(workers))
    indices = list(only) if only is not None else range(plan.sequences)
    some = indices[:: max(1, len(indices) // _DRAWN)]
    drawn = [configuration_of(plan, index) for index in some]
    share = len(indices) / len(drawn)
    frames = round(share * sum(each.trajectory.frames for each in drawn))
    cost = _told(drawn, partial(_finish_of_plan, plan), share, workers)
    print(f"{root}: {len(indices)} sequences, {frames} frames, {cost}")


def dry_run_of_frames(root: Path, settings: Configuration) -> str:
    """Return the estimated cost of rendering a sequence, in a line. Raises UserError if absurd."""
    check_stage("render", settings, root)
    camera, frames, shading = settings.camera, settings.trajectory.frames, settings.render
    integrator: str = shading.integrator
    if integrator == "auto":
        integrator = "path, as too few samples are needed for baked light to pay"
        if may_pay(shading, frames, camera.width * camera.height):
            integrator = "path"
        if may_bake(settings):
            integrator = "baked if that pays for the whole sequence, else path"
    costs = _told([settings], lambda _dataset: None)
    return (
        f"{root}: {frames} frames of {camera.width} × {camera.height}, {costs}, "
        f"up to {size(needed_bytes(settings, 'render')[0])} of memory; integrator: {integrator}"
    )


def may_bake(settings: Configuration) -> bool:
    """True if `auto` may bake the light of the sequence: where it does not, that is less work."""
    camera, shading, scene = settings.camera, settings.render, settings.scene
    return (
        shading.integrator == "auto"
        and scene.has_bounces
        and not scene.is_hazy
        and scene.is_diffuse
        and may_pay(shading, settings.trajectory.frames, camera.width * camera.height)
    )


def cost_of(drawn: Sequence[Configuration], finish: Finish) -> Cost:
    """Return the cost of some sequences, from one of each third of them, by scene and size."""
    ordered = sorted(drawn, key=lambda each: (each.scene.kind, _pixels(each)))
    total = np.zeros(3)
    for part in np.array_split(np.arange(len(ordered)), min(_MEASURED, len(ordered))):
        members = [ordered[index] for index in part]
        middle = members[len(members) // 2]
        camera = middle.camera
        say(name := f"measuring {middle.scene.kind}, {camera.width} × {camera.height} px")
        with step(name):
            once, setup, of_pixel = measured(middle, finish)
        total += once + len(members) * setup + sum(map(_pixels, members)) * of_pixel
    return total


def measured(settings: Configuration, finish: Finish) -> tuple[Cost, Cost, Cost]:
    """Measure a strip of a sequence's first two frames; leave nothing.

    Returns the cost of compilation, of the scene with its baked light, and of a pixel of a frame.
    """
    whole = _strip(settings)
    path = whole.trajectory.model_copy(update={"frames": min(whole.trajectory.frames, 2)})
    strip = whole.model_copy(update={"trajectory": path})
    with TemporaryDirectory(prefix="megalopta-probe-") as folder, silent():
        dataset = Dataset(Path(folder), strip)
        with times_of_steps() as steps:
            with step("first"):
                writer = FrameWriter(dataset, whole)
                writer.write(0)
            with step("second"):
                writer.write(path.frames - 1)
            with step("files"):
                write_previews(dataset)
                finish(dataset)

        def time_of(*names: str) -> Cost:
            found = [steps[name] for name in names if name in steps]
            wall_s, cpu_s = (
                (spent.seconds for spent in found),
                (spent.cpu_seconds for spent in found),
            )
            return np.array([sum(wall_s), sum(cpu_s), 0.0])

        # the first frame's radiance and truth count as compilation beyond those of the second
        frame, baking = time_of("second"), time_of("baking light")
        scene = time_of("building the scene", "loading the scene") - baking
        once = np.maximum(time_of("first") - scene - baking - frame, 0)
        files = time_of("files")
        files[2] = sum(file.stat().st_size for file in files_in([dataset.root]))
        frame += files / path.frames
    wider = settings.camera.height / strip.camera.height
    of_pixel = frame / (strip.camera.width * strip.camera.height)
    closing = _CLOSING_PATHS * settings.scene.is_lit_from_outside
    closing_pixels = closing / settings.render.samples_per_pixel
    closing_cost = of_pixel * closing_pixels * [1, 1, 0]
    return once, scene + baking * wider + closing_cost, of_pixel


def _told(
    drawn: Sequence[Configuration], finish: Finish, share: float = 1.0, workers: int = 1
) -> str:
    """Return size and time of sequences, a share of all, as text."""
    seconds, cpu_seconds, bytes_ = (share * cost_of(drawn, finish)).tolist()
    text = f"about {size(bytes_)}, about {duration(seconds / workers)}"
    if workers > 1:
        text += f" with {workers} workers"
    text += f" ({duration(cpu_seconds)} of processor time)"
    is_most = any(map(may_bake, drawn))
    return text + (", at most: light is baked only if that takes less work" if is_most else "")


def _finish_of_plan(plan: Plan, dataset: Dataset) -> None:
    """Run the work after rendering of a sequence."""
    STAGES["sense"].work(dataset)
    write_flow_files(dataset, plan.flow_files)


def _pixels(settings: Configuration) -> int:
    """Return the pixels of all frames."""
    return settings.camera.width * settings.camera.height * settings.trajectory.frames


def _strip(settings: Configuration) -> Configuration:
    """Return a sequence with few rows."""
    camera, shading = settings.camera, settings.render
    passes = (shading.max_passes if shading.target_error else 1) * (
        1 if settings.shutter.is_instant else 2
    )
    pixels = min(_PIXELS, _PATHS / (shading.samples_per_pixel * passes))
    if may_bake(settings) or shading.integrator == "baked":
        pixels = _BAKED_PIXELS
        shading = shading.model_copy(update={"integrator": "baked"})
    rows = min(max(math.ceil(pixels / camera.width), _FEWEST_ROWS), camera.height)
    return settings.model_copy(update={"camera": camera.with_rows(rows), "render": shading})
