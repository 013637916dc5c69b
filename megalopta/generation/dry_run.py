"""How large a plan, or one sequence, will be, measured on two small frames of a few sequences.

Sequences that take the same code are a group. Of each group one is measured, with few trees: a
strip of each image is rendered and exposed, as wide as the image, so that its pixels are those of
the whole, and with as many rows as take a second or two. All others follow by what times go by:
building by the expected triangles, radiance by the samples, all else by the pixels and frames.
Baked light that is asked for is baked for the strip; where `auto` may bake, paths are traced, and
the time told is the most that `auto` takes.
"""

import math
import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from megalopta.config.drawing import configuration_of
from megalopta.config.model import Configuration
from megalopta.config.recipe import Plan
from megalopta.core.errors import UserError
from megalopta.core.progress import Spent, duration, say, silent, step, times_of_steps
from megalopta.dataset.store import Dataset, files_in
from megalopta.generation.making import write_flow_files
from megalopta.render import MEASURED_EVERY
from megalopta.render.baking.choice import AT_EQUAL_ERROR, may_pay
from megalopta.stages.limits import needed_bytes, size
from megalopta.stages.pipeline import check_stage
from megalopta.stages.registry import STAGES
from megalopta.stages.render import FrameWriter, build, write_previews

_BUDGET_S = 20.0
"""Processor time, beyond which nothing more is measured."""
_DRAWN = 200
_BUILT, _FEW = 150, 20
"""Things in a scene that is built as it is; else in the one from which more are told."""
_SOON_S = 1.5
"""A first run of less is measured again: it loaded."""
_FRAMES = 2
_MOST_PIXELS, _FEWEST_ROWS = 8192, 8
_PATHS, _DIRECT_PATHS, _BAKED_PIXELS = 60_000, 200_000, 256
"""In a strip: light paths of a scene with bounces and of one that glows, pixels that are baked"""
_CLOSING = 200_000
_ONCE = "counting the rays that baked light takes", "baking light"
_SETUP = "building the scene", "loading the scene"

_Group: TypeAlias = tuple[object, ...]
Time = NDArray[np.float64]
"""Of a clock, and of processors (s), (2,)."""
Finish = Callable[[Dataset], None]
"""What follows the rendering of a dataset's frames, such as sensors."""


@dataclass(frozen=True)
class Scale:
    """What a sequence's cost goes by."""

    things: int
    """In the scene, such as trees; 0 where they are not counted."""
    triangles: float
    """Expected: of scenes of one kind in proportion, within a half."""
    pixels: int
    samples: float
    """Of a pass of a frame."""
    frames: int
    passes: int
    """Over all frames, those by which the error is measured included."""
    closing: int
    """Light paths that measure the light on the ground, the canopy and what is left out."""
    most: float
    """Times as long as paths take, at most, where `auto` bakes; 1 where it does not."""

    @classmethod
    def of(cls, settings: Configuration) -> "Scale":
        """That of a configuration."""
        camera, shutter = settings.camera, settings.shutter
        pixels = camera.width * camera.height
        passes = 1 if shutter.is_instant else 2
        samples = float(pixels * settings.render.samples_per_pixel * passes)
        things = sum(settings.scene.counts.values())
        way_m = np.diff(settings.trajectory.poses()[:, :3, 3], axis=0)
        triangles = settings.scene.expected_triangles(float(np.linalg.norm(way_m, axis=1).sum()))
        frames, shading = settings.trajectory.frames, settings.render
        measured = 0 if shading.target_error else math.ceil(frames / MEASURED_EVERY)
        baked = shading.integrator == "auto" and may_pay(shading, frames, pixels)
        closing = _CLOSING if settings.scene.is_lit_from_outside else 0
        most = AT_EQUAL_ERROR if baked else 1.0
        passes = frames + measured
        return cls(things, triangles, pixels, samples, frames, passes, closing, most)


@dataclass(frozen=True)
class Probe:
    """What a short piece of a sequence took."""

    scale: Scale
    setup: Time
    """Building and loading the scene; its plants are grown before if others share them."""
    compiling: Time
    """What the first frame takes beyond others; what it compiles is kept."""
    once: Time
    """Baking light."""
    radiance: Time
    """Of a pass of a frame."""
    rest: Time
    """Of a frame: truth, files, sensors."""
    frame_bytes: float


class Foreseen(NamedTuple):
    """What sequences take: time (s) by the clock and of processors, and bytes on disk."""

    time: Time
    bytes: float


def probe(settings: Configuration, things: int, finish: Finish, shares_plants: bool) -> Probe:
    """Measure two frames of a strip, of a scene with at most so many things, and what follows."""
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
    """Put together what the first frame took, with all before it, and another that is warm."""
    scale, once = Scale.of(dataset.configuration), _time(first, *_ONCE)
    passes = 2 if scale.frames == 1 and scale.passes == 2 else 1
    radiance = _time(steps, "rendering radiance") / passes
    beyond = _time(first, "rendering radiance") - 2 * radiance
    rest = _time(steps, "frame") - passes * radiance + _time(steps, "files") / scale.frames
    bytes_ = sum(path.stat().st_size for path in files_in([dataset.root]))
    return Probe(
        scale,
        setup=_time(first, *_SETUP) - once,
        compiling=np.maximum(beyond, 0),
        once=once,
        radiance=radiance,
        rest=rest,
        frame_bytes=bytes_ / scale.frames,
    )


def foresee(scale: Scale, like: Probe, is_first: bool = True) -> Foreseen:
    """Return what a sequence takes, in proportion to a probe of its like.

    If it is the first of its like it compiles what measures the light on the ground, the canopy and
    what paths leave out, which takes as long as what the probe compiled of frames.
    """
    pixels = scale.pixels / like.scale.pixels
    samples = scale.most * scale.passes * scale.samples + scale.closing
    total = (
        like.setup * (scale.triangles / like.scale.triangles)
        + like.once * pixels
        + like.radiance * (samples / like.scale.samples)
        + like.rest * (scale.frames * pixels)
        + like.compiling * (is_first and scale.closing > 0)
    )
    return Foreseen(total, scale.frames * pixels * like.frame_bytes)


def _small(settings: Configuration, things: int) -> Configuration:
    """A strip of the whole sequence, of a scene with at most so many things."""
    scene, camera, shading = settings.scene, settings.camera, settings.render
    fewer = {
        name: min(count, things)
        for name, count in scene.counts.items()
        if name in type(scene).model_fields
    }
    if shading.integrator == "auto":
        shading = shading.model_copy(update={"integrator": "path"})
    rows = math.ceil(_pixels(settings) / camera.width)
    rows = min(max(rows, _FEWEST_ROWS), camera.height)
    return settings.model_copy(
        update={
            "scene": scene.model_copy(update=fewer),
            "camera": camera.model_copy(update={"height": rows}),
            "render": shading,
        }
    )


def _pixels(settings: Configuration) -> float:
    if settings.render.integrator == "baked":
        return _BAKED_PIXELS
    paths = _PATHS if settings.scene.has_bounces else _DIRECT_PATHS
    passes = settings.render.max_passes if settings.render.target_error else 1
    return min(_MOST_PIXELS, paths / (settings.render.samples_per_pixel * passes))


def _time(steps: Mapping[str, Spent], *names: str) -> Time:
    found = [steps[name] for name in names if name in steps]
    return np.array(
        [sum(each.seconds for each in found), sum(each.cpu_seconds for each in found)], float
    )


def dry_run(root: Path, plan: Plan, workers: int = 1, only: Sequence[int] | None = None) -> None:
    """Print what a plan will take, and make nothing of it.

    The time is that of this machine, with as many sequences side by side as there are workers.
    """
    indices = list(only) if only is not None else range(plan.sequences)
    some = indices[:: max(1, len(indices) // _DRAWN)]
    drawn = [configuration_of(plan, index) for index in some]
    share = len(indices) / len(drawn)
    frames = round(share * sum(each.trajectory.frames for each in drawn))
    told = _told(drawn, partial(finish_of_plan, plan), share, workers)
    print(f"{root}: {len(indices)} sequences, {frames} frames, {told}")
    say("measured on strips of two frames each; all beyond them is extrapolated")


def dry_run_of_frames(root: Path, settings: Configuration) -> str:
    """What rendering one sequence will take, in a line. Raises UserError where that is absurd."""
    check_stage("render", settings, root)
    camera, frames, shading = settings.camera, settings.trajectory.frames, settings.render
    integrator: str = shading.integrator
    if integrator == "auto":
        integrator = "path, as these are too few samples to bake light for"
        if may_pay(shading, frames, camera.width * camera.height):
            integrator = "baked, where a look at the whole sequence finds that it pays, else path"
    costs = _told([settings], lambda _dataset: None)
    return (
        f"{root}: {frames} frames of {camera.width} × {camera.height}, {costs}, "
        f"up to {size(needed_bytes(settings, 'render')[0])} of memory; integrator: {integrator}"
    )


def _told(
    drawn: Sequence[Configuration], finish: Finish, share: float = 1.0, workers: int = 1
) -> str:
    """Size and time of sequences, a share of all, for a person."""
    costs = costs_of(drawn, finish)
    seconds, cpu_seconds = share * np.sum([each.time for each in costs], axis=0)
    bytes_ = share * sum(each.bytes for each in costs)
    text = f"about {size(bytes_)}, about {duration(seconds / workers)}"
    if workers > 1:
        text += f" with {workers} workers"
    text += f" ({duration(cpu_seconds)} of processors)"
    is_most = any(Scale.of(each).most > 1 for each in drawn)
    return text + (", at most: baked light takes less" if is_most else "")


def costs_of(drawn: Sequence[Configuration], finish: Finish) -> list[Foreseen]:
    """What each of some sequences takes, by probes of a few."""
    groups: dict[_Group, list[Configuration]] = defaultdict(list)
    for each in drawn:
        groups[_group(each)].append(each)
    probes = _measured(groups, finish)
    costs: list[Foreseen] = []
    compiled: set[_Group] = set()
    for each in drawn:
        group = _group(each)
        costs.append(foresee(Scale.of(each), probes[group], group not in compiled))
        compiled.add(group)
    return costs


def finish_of_plan(plan: Plan, dataset: Dataset) -> None:
    """What follows the rendering of a sequence."""
    STAGES["sense"].work(dataset)
    write_flow_files(dataset, plan.flow_files)


def _measured(
    groups: Mapping[_Group, Sequence[Configuration]], finish: Finish
) -> dict[_Group, Probe]:
    """A probe of every group: of the most frequent first, of the rest that of its like."""
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
        say(f"{len(unmeasured)} kinds of sequences are told by others: time to measure is over")
    return found


def _probed(members: Sequence[Configuration], finish: Finish) -> Probe:
    """Measure the largest image of a group, with few things if these differ or are many.

    What took little, or mostly compiled sensors, is measured again, now that all is loaded.
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
    """What decides which code a sequence takes; its first part is the scene's kind."""
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
        shading.integrator,
        shading.target_error is None,
    )
