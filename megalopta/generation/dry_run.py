"""Estimate the cost of a plan, or of one sequence, from two small frames of a few sequences.

Sequences that run the same code are a group. One of each group is measured, with few trees: a strip
of each image is rendered and exposed, as wide as the image, so that its pixels are those of the
whole, with as many rows as take a second or two. All others are scaled: building by the expected
triangles, radiance by the samples, all else by the pixels and frames. To count the rays of baked
light takes nearly as long for a strip, so it is part of building. Where `auto` may bake, the probe
does, and the time is an upper bound: light is baked only if that takes less work.
"""

import math
import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from megalopta.config.drawing import configuration_of
from megalopta.config.model import Configuration
from megalopta.config.recipe import Plan
from megalopta.core.errors import UserError
from megalopta.core.progress import Spent, duration, say, silent, step, times_of_steps
from megalopta.dataset.store import Dataset, files_in
from megalopta.generation.jobs import threads_of, use_threads
from megalopta.generation.making import write_flow_files
from megalopta.render import MEASURED_EVERY
from megalopta.render.baking.choice import may_pay
from megalopta.stages.limits import needed_bytes, size
from megalopta.stages.pipeline import check_stage
from megalopta.stages.registry import STAGES
from megalopta.stages.render import FrameWriter, build, write_previews

_BUDGET_S = 20.0
"""Processor time after which nothing more is measured (s)."""
_DRAWN = 200
_BUILT, _FEW = 150, 20
"""Most things in a scene that is built as it is; things in the reduced scene otherwise"""
_SOON_S = 1.5
"""A shorter first run is repeated: it included loading (s)."""
_FRAMES = 2
_MOST_PIXELS, _FEWEST_ROWS = 8192, 8
_PATHS, _DIRECT_PATHS, _BAKED_PIXELS = 60_000, 200_000, 256
"""Size of a strip: light paths with bounces, light paths of self-luminous scenes, baked pixels"""
_CLOSING = 200_000
_ONCE = "baking light"
_SETUP = "building the scene", "loading the scene"

_Group: TypeAlias = tuple[object, ...]
Cost = NDArray[np.float64]
"""Wall-clock time and processor time (s), and bytes on disk, (3,)."""
Finish = Callable[[Dataset], None]
"""Work after the rendering of a dataset's frames, such as sensors."""


@dataclass(frozen=True)
class Scale:
    """Quantities that a sequence's cost is proportional to."""

    things: int
    """Things in the scene, such as trees; 0 if they are not counted."""
    triangles: float
    """Expected triangles, proportional among scenes of one kind, within 50 %."""
    pixels: int
    samples: float
    """Samples of one pass of a frame."""
    frames: int
    passes: int
    """Passes over all frames, including those that measure the error."""
    closing: int
    """Light paths that measure the light on the ground, the canopy and the truncation bias."""

    @classmethod
    def of(cls, settings: Configuration) -> "Scale":
        """Return the scale of a configuration."""
        camera, shutter = settings.camera, settings.shutter
        pixels = camera.width * camera.height
        passes = 1 if shutter.is_instant else 2
        samples = float(pixels * settings.render.samples_per_pixel * passes)
        things = sum(settings.scene.counts.values())
        way_m = np.diff(settings.trajectory.poses()[:, :3, 3], axis=0)
        triangles = settings.scene.expected_triangles(float(np.linalg.norm(way_m, axis=1).sum()))
        frames, shading = settings.trajectory.frames, settings.render
        measured = 0 if shading.target_error else math.ceil(frames / MEASURED_EVERY)
        closing = _CLOSING if settings.scene.is_lit_from_outside else 0
        passes = frames + measured
        return cls(things, triangles, pixels, samples, frames, passes, closing)


@dataclass(frozen=True)
class Probe:
    """Cost of a short piece of a sequence."""

    scale: Scale
    setup: Cost
    """Building and loading the scene, and counting rays; shared plants are grown before."""
    compiling: Cost
    """Additional time of the first frame; compiled code is kept."""
    once: Cost
    """Baking light."""
    radiance: Cost
    """Radiance of one pass of a frame."""
    rest: Cost
    """Rest of a frame: truth, files, sensors."""


def probe(settings: Configuration, things: int, finish: Finish, shares_plants: bool) -> Probe:
    """Measure two frames of a strip of a scene with at most `things` things, and `finish`."""
    whole = _small(settings, things)
    path = whole.trajectory.model_copy(update={"frames": min(whole.trajectory.frames, _FRAMES)})
    short = whole.model_copy(update={"trajectory": path})
    with TemporaryDirectory(prefix="megalopta-probe-") as folder, silent():
        dataset = Dataset(Path(folder), short)
        if shares_plants:
            build(whole)
        with times_of_steps() as first:
            writer = FrameWriter(dataset, whole)
            writer.write(0)
        with times_of_steps() as steps:
            with step("frame"):
                writer.write(path.frames - 1)
            with step("files"):
                write_previews(dataset)
                finish(dataset)
        return _probe(dataset, first, steps)


def _probe(dataset: Dataset, first: Mapping[str, Spent], steps: Mapping[str, Spent]) -> Probe:
    """Combine the first frame, including setup, and a second, warm one."""
    scale, once = Scale.of(dataset.configuration), _time(first, _ONCE)
    passes = 2 if scale.frames == 1 and scale.passes == 2 else 1
    radiance = _time(steps, "rendering radiance") / passes
    beyond = _time(first, "rendering radiance") - 2 * radiance
    files = _time(steps, "files")
    files[2] = sum(path.stat().st_size for path in files_in([dataset.root]))
    return Probe(
        scale,
        setup=_time(first, *_SETUP) - once,
        compiling=np.maximum(beyond, 0),
        once=once,
        radiance=radiance,
        rest=_time(steps, "frame") - passes * radiance + files / scale.frames,
    )


def foresee(scale: Scale, like: Probe, is_first: bool = True) -> Cost:
    """Return the cost of a sequence, in proportion to a probe of its group.

    The first of a group also compiles the measurement of light on the ground, canopy and truncation
    bias, which takes as long as the frames' code in the probe.
    """
    pixels = scale.pixels / like.scale.pixels
    samples = scale.passes * scale.samples + scale.closing
    return np.asarray(
        like.setup * (scale.triangles / like.scale.triangles)
        + like.once * pixels
        + like.radiance * (samples / like.scale.samples)
        + like.rest * (scale.frames * pixels)
        + like.compiling * (is_first and scale.closing > 0)
    )


def _small(settings: Configuration, things: int) -> Configuration:
    """Return a strip of the whole sequence, of a scene with at most `things` things."""
    scene, camera, shading = settings.scene, settings.camera, settings.render
    fewer = {
        name: min(count, things)
        for name, count in scene.counts.items()
        if name in type(scene).model_fields
    }
    shading = shading.model_copy(update={"integrator": _integrator_of(settings)})
    rows = math.ceil(_pixels(settings) / camera.width)
    rows = min(max(rows, _FEWEST_ROWS), camera.height)
    return settings.model_copy(
        update={
            "scene": scene.model_copy(update=fewer),
            "camera": camera.with_rows(rows),
            "render": shading,
        }
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


def _integrator_of(settings: Configuration) -> str:
    """Return the integrator of a probe, of the one with more work if it is not known."""
    if settings.render.integrator == "auto":
        return "baked" if may_bake(settings) else "path"
    return settings.render.integrator


def _pixels(settings: Configuration) -> float:
    if _integrator_of(settings) == "baked":
        return _BAKED_PIXELS
    paths = _PATHS if settings.scene.has_bounces else _DIRECT_PATHS
    passes = settings.render.max_passes if settings.render.target_error else 1
    return min(_MOST_PIXELS, paths / (settings.render.samples_per_pixel * passes))


def _time(steps: Mapping[str, Spent], *names: str) -> Cost:
    found = [steps[name] for name in names if name in steps]
    return np.array(
        [sum(each.seconds for each in found), sum(each.cpu_seconds for each in found), 0.0]
    )


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
    cost = _told(drawn, partial(finish_of_plan, plan), share, workers)
    print(f"{root}: {len(indices)} sequences, {frames} frames, {cost}")
    say("extrapolated from measured strips of two frames each")


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


def _told(
    drawn: Sequence[Configuration], finish: Finish, share: float = 1.0, workers: int = 1
) -> str:
    """Return size and time of sequences, a share of all, as text."""
    seconds, cpu_seconds, bytes_ = (share * np.sum(costs_of(drawn, finish), axis=0)).tolist()
    text = f"about {size(bytes_)}, about {duration(seconds / workers)}"
    if workers > 1:
        text += f" with {workers} workers"
    text += f" ({duration(cpu_seconds)} of processor time)"
    is_most = any(map(may_bake, drawn))
    return text + (", at most: light is baked only if that takes less work" if is_most else "")


def costs_of(drawn: Sequence[Configuration], finish: Finish) -> list[Cost]:
    """Return the costs of some sequences, by group, from probes of a few."""
    groups: dict[_Group, list[Configuration]] = defaultdict(list)
    for each in drawn:
        groups[_group(each)].append(each)
    probes = _measured(groups, finish)
    return [
        foresee(Scale.of(each), probes[group], is_first=not number)
        for group, members in groups.items()
        for number, each in enumerate(members)
    ]


def finish_of_plan(plan: Plan, dataset: Dataset) -> None:
    """Run the work after rendering of a sequence."""
    STAGES["sense"].work(dataset)
    write_flow_files(dataset, plan.flow_files)


def _measured(
    groups: Mapping[_Group, Sequence[Configuration]], finish: Finish
) -> dict[_Group, Probe]:
    """Return a probe of every group: of the most frequent first; the rest use a similar one."""
    until = time.process_time() + _BUDGET_S
    found: dict[_Group, Probe] = {}
    for key in sorted(groups, key=lambda each: -len(groups[each])):
        if time.process_time() < until or not found:
            found[key] = _probed(groups[key], finish)
    unmeasured = [key for key in groups if key not in found]
    for key in unmeasured:
        alike = [other for other in found if other[0] == key[0]] or list(found)
        found[key] = found[alike[0]]
    if unmeasured:
        say(f"{len(unmeasured)} kinds of sequences are estimated from others, for lack of time")
    return found


def _probed(members: Sequence[Configuration], finish: Finish) -> Probe:
    """Measure the largest image of a group, with few things if these differ or are many.

    A short run, or one that mostly compiled sensors, is repeated once all is loaded.
    """
    things = [Scale.of(each).things for each in members]
    few = max(things) if max(things) == min(things) <= _BUILT else min(*things, _FEW)
    shares_plants = len({getattr(each.scene, "seed", 0) for each in members}) == 1
    largest = max(members, key=lambda each: Scale.of(each).samples)
    camera, scene = largest.camera, largest.scene
    while True:
        counts = "".join(f"{min(n, few)} {name}, " for name, n in scene.counts.items())
        say(name := f"measuring {scene.kind}, {counts}{camera.width} × {camera.height} px")
        start = time.process_time()
        try:
            with step(name):
                found = probe(largest, few, finish, shares_plants)
                spent = time.process_time() - start
                if spent < _SOON_S or found.rest[1] * found.scale.frames > spent / 2:
                    return probe(largest, few, finish, shares_plants)
                return found
        except UserError:  # few trees do not surround a long path
            if few >= Scale.of(largest).things:
                raise
            few *= 4


def _group(settings: Configuration) -> _Group:
    """Return the properties that decide which code a sequence runs, the scene's kind first."""
    shutter, shading = settings.shutter, settings.render
    return (
        settings.scene.kind,
        settings.scene.is_hazy,
        settings.scene.is_moving,
        len(settings.objects),
        settings.camera.kind,
        shutter.exposure_s > 0,
        shutter.readout_s > 0,
        len(shading.bands_nm),
        _integrator_of(settings),
        shading.target_error is None,
    )
