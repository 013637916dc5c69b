"""How large a plan will be, measured on a few frames of a few of its sequences.

Sequences that take the same code are a group. Of each group one is measured, with few trees, and
all others follow in proportion (`probing.py`).
"""

import time
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TypeAlias

import numpy as np

from megalopta.config.drawing import configuration_of
from megalopta.config.model import Configuration
from megalopta.config.recipe import Plan
from megalopta.core.errors import UserError
from megalopta.core.progress import duration, say, step
from megalopta.dataset.store import Dataset
from megalopta.generation.making import write_flow_files
from megalopta.generation.probing import Finish, Foreseen, Probe, Scale, foresee, probe
from megalopta.render.baking.choice import may_pay
from megalopta.stages.limits import needed_bytes, size
from megalopta.stages.pipeline import check_stage
from megalopta.stages.registry import STAGES

_BUDGET_S = 20.0
"""Processor time, beyond which nothing more is measured."""
_DRAWN = 200
_BUILT, _FEW = 150, 20
"""Things in a scene that is built as it is; else in the one from which more are told."""
_SOON_S = 1.5
"""A first run of less is measured again: it loaded."""

_Group: TypeAlias = tuple[object, ...]


def dry_run(root: Path, plan: Plan, workers: int = 1, only: Sequence[int] | None = None) -> None:
    """Print what a plan will take, and make nothing of it.

    The time is that of this machine, with as many sequences side by side as there are workers.
    """
    indices = list(only) if only is not None else range(plan.sequences)
    some = indices[:: max(1, len(indices) // _DRAWN)]
    drawn = [configuration_of(plan, index) for index in some]
    costs = costs_of(plan, drawn)
    share = len(indices) / len(drawn)
    frames = round(share * sum(each.trajectory.frames for each in drawn))
    print(f"{root}: {len(indices)} sequences, {frames} frames, {_told(costs, share, workers)}")
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
    costs = _told(_foreseen([settings], lambda _dataset: None))
    return (
        f"{root}: {frames} frames of {camera.width} × {camera.height}, {costs}, "
        f"up to {size(needed_bytes(settings, 'render')[0])} of memory; integrator: {integrator}"
    )


def costs_of(plan: Plan, drawn: Sequence[Configuration]) -> list[Foreseen]:
    """What each of some sequences of a plan takes, by probes of a few."""
    return _foreseen(drawn, partial(_finish, plan))


def _told(costs: Iterable[Foreseen], share: float = 1.0, workers: int = 1) -> str:
    """Size and time of sequences, a share of all, for a person."""
    costs = list(costs)
    seconds, cpu_seconds = share * np.sum([each.time for each in costs], axis=0)
    bytes_ = share * sum(each.bytes for each in costs)
    text = f"about {size(bytes_)}, about {duration(seconds / workers)}"
    if workers > 1:
        text += f" with {workers} workers"
    text += f" ({duration(cpu_seconds)} of processors)"
    return text + (", at most: baked light takes less" if any(c.most for c in costs) else "")


def _foreseen(drawn: Sequence[Configuration], finish: Finish) -> list[Foreseen]:
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


def _finish(plan: Plan, dataset: Dataset) -> None:
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
            found[key] = _of_largest(groups[key], finish)
    unmeasured = [key for key in groups if key not in found]
    for key in unmeasured:
        alike = [other for other in found if other[0] == key[0]] or list(found)
        found[key] = found[alike[0]]
    if unmeasured:
        say(f"{len(unmeasured)} kinds of sequences are told by others: time to measure is over")
    return found


def _of_largest(members: Sequence[Configuration], finish: Finish) -> Probe:
    """Measure the largest image of a group, with few things if these differ or are many."""
    things = [Scale.of(each).things for each in members]
    few = max(things) if max(things) == min(things) <= _BUILT else min(*things, _FEW)
    shares_plants = len({getattr(each.scene, "seed", 0) for each in members}) == 1
    largest = max(members, key=lambda each: Scale.of(each).samples)
    return _probed(largest, few, finish, shares_plants)


def _probed(settings: Configuration, things: int, finish: Finish, shares_plants: bool) -> Probe:
    """A probe of a sequence; one that took little is made again, now that all is loaded."""
    start = time.process_time()
    camera, scene = settings.camera, settings.scene
    counts = "".join(f"{min(n, things)} {name}, " for name, n in scene.counts.items())
    name = f"measuring {scene.kind}, {counts}{camera.width} × {camera.height} px"
    say(name)
    with step(name):
        try:
            found = probe(settings, things, finish, shares_plants)
        except UserError:  # few trees do not surround a long path
            if things >= Scale.of(settings).things:
                raise
            return _probed(settings, 4 * things, finish, shares_plants)
        if time.process_time() - start < _SOON_S:
            found = probe(settings, things, finish, shares_plants)
    return found


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
