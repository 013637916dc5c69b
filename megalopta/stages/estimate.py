"""Estimate the cost of a plan to a factor of two.

Two strips of a frame of at most three sequences are rendered; the second is multiplied.
"""

import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from megalopta.config.drawing import configuration_of, plan_warnings
from megalopta.config.model import Configuration
from megalopta.config.recipe import Plan
from megalopta.core import files
from megalopta.core.progress import duration, say, silent
from megalopta.dataset.store import Dataset
from megalopta.render import dr
from megalopta.stages.jobs import threads_of
from megalopta.stages.limits import size
from megalopta.stages.make import exposure_statistics, write_flow_files
from megalopta.stages.noise_warning import light_note
from megalopta.stages.registry import STAGES
from megalopta.stages.render import FrameWriter, write_previews

_FEWEST_ROWS, _PIXELS, _PATHS = 8, 8192, 60_000


def estimate_plan(
    root: Path, plan: Plan, workers: int = 1, only: Sequence[int] | None = None
) -> str:
    """Return the estimated cost of a plan in a line, without making anything.

    The time is that of this machine, with as many parallel sequences as there are workers, each
    with its share of the cores.
    """
    dr.set_thread_count(threads_of(workers))
    for warning in plan_warnings(plan):
        say(warning)
    indices = list(only) if only is not None else range(plan.sequences)
    drawn = [configuration_of(plan, n) for n in indices[:: max(1, len(indices) // 200)]]
    share = len(indices) / len(drawn)
    frames = round(share * sum(settings.trajectory.frames for settings in drawn))
    seconds, bytes_ = cost_of(drawn, plan)
    text = f"about {size(share * bytes_)}, about {duration(share * seconds / workers)}"
    more = f" with {workers} workers" if workers > 1 else ""
    many = "s" * (len(indices) != 1)
    return f"{root}: {len(indices)} sequence{many}, {frames} frames, {text}{more}"


def cost_of(drawn: Sequence[Configuration], plan: Plan) -> tuple[float, float]:
    """Return seconds and bytes of some sequences, from one of each scene, at most three."""
    ordered = sorted(drawn, key=lambda settings: (settings.scene.kind, _pixels(settings)))
    total, kinds = np.zeros(2), {(settings.scene.kind, _pixels(settings)) for settings in drawn}
    parts = min(3, max(len(plan.scenes), len(kinds)), len(ordered))
    for part in np.array_split(np.arange(len(ordered)), parts):
        members = [ordered[index] for index in part]
        middle = members[len(members) // 2]
        say(f"measuring {middle.scene.kind}, {middle.camera.width} × {middle.camera.height} px")
        setup_s, of_pixel = measured(middle, plan)
        total += sum(map(_pixels, members)) * of_pixel
        total[0] += len(members) * setup_s
    return float(total[0]), float(total[1])


def measured(settings: Configuration, plan: Plan) -> tuple[float, NDArray[np.float64]]:
    """Return seconds before the second frame, and seconds and bytes of a pixel of a frame."""
    camera, shading = settings.camera, settings.render
    rows = min(_PIXELS, _PATHS / shading.samples_per_pixel) / camera.width
    strip = camera.with_rows(min(max(int(rows), _FEWEST_ROWS), camera.height))
    integrator = "path" if shading.integrator == "auto" else shading.integrator
    changes = {"camera": strip, "render": shading.model_copy(update={"integrator": integrator})}
    narrow = settings.model_copy(update=changes)
    path = narrow.trajectory.model_copy(update={"frames": min(narrow.trajectory.frames, 2)})
    with TemporaryDirectory(prefix="megalopta-probe-") as folder, silent():
        dataset = Dataset(Path(folder), narrow.model_copy(update={"trajectory": path}))
        start = time.perf_counter()
        writer = FrameWriter(dataset, narrow)
        writer.write(0)
        first = time.perf_counter()
        writer.write(path.frames - 1)
        write_previews(dataset)
        STAGES["sense"].work(dataset)
        write_flow_files(dataset, plan.flow_files)
        seconds = time.perf_counter() - first
        bytes_ = sum(file.stat().st_size for file in files.files_in([dataset.root])) / path.frames
        note = light_note(exposure_statistics(dataset))
    if note:
        say(note)
    return first - start, np.array([seconds, bytes_]) / (strip.width * strip.height)


def _pixels(settings: Configuration) -> int:
    return settings.camera.width * settings.camera.height * settings.trajectory.frames
