"""Make the missing sequences of a plan, and keep finished ones.

A sequence is an ordinary dataset in `.making/SEQ/data` until it is complete, so that a killed run
continues inside it.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from megalopta.config.drawing import check_plan, configuration_of, sequence_name, split_of
from megalopta.config.model import differences
from megalopta.config.recipe import FlowFile, Plan
from megalopta.core.errors import UserError
from megalopta.core.format_numbers import written
from megalopta.core.progress import say
from megalopta.dataset.frames import read_radiance_frame, read_truth_frame
from megalopta.dataset.layout import Tree
from megalopta.dataset.record import MADE, ExposureStatistics, SequenceRecord, SequenceStatistics
from megalopta.dataset.stereo import read_disparity, write_kitti_disparity
from megalopta.dataset.store import Dataset, exposure_name, hashes_of, refuse_others_folder
from megalopta.flow.formats import read_flo, write_flo5, write_kitti_png
from megalopta.generation.jobs import run_jobs
from megalopta.generation.staging import Staged, at_work
from megalopta.render import out_of_view
from megalopta.stages.ledger import Ledger
from megalopta.stages.pipeline import check_stage, run_stage
from megalopta.stages.registry import made_with, provenance_changes
from megalopta.stages.sense import open_exposure

_COUNTED = 10_000
"""Sequences of which the splits are counted."""
_COMPARED = 50
"""Finished sequences whose configuration is compared with the plan's."""
_FLOW, _DISPARITY = "training/flow", "training/disparities"
READERS: dict[str, Callable[[Path], Any]] = {_FLOW: read_flo, _DISPARITY: read_disparity}
"""Readers of the files that are written in other layouts, too, by folder"""
_Layout: TypeAlias = tuple[FlowFile, str, str, Callable[[Path, Any], None]]
_LAYOUTS: tuple[_Layout, ...] = (
    ("kitti_png", _FLOW, "training/flow_kitti", write_kitti_png),
    ("flo5", _FLOW, "training/flow_flo5", write_flo5),
    ("kitti_png", _DISPARITY, f"{_DISPARITY}_kitti", write_kitti_disparity),
)
"""Files in other layouts: folder of the source, folder and writer"""


def make(
    root: Path,
    plan: Plan,
    *,
    only: Iterable[int] | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    retry: bool = False,
) -> Tree:
    """Make the missing sequences of a plan, or `only` some of them.

    `workers` are processes of this machine, `scheduler` is the address of a Dask cluster; without
    both, all are made in this process. With `retry`, only failed ones are made. Raises UserError if
    the folder holds other files or sequences of another plan, if the machine refuses, such as a
    full disk, or, after all others are made, if sequences failed.
    """
    tree = Tree(root.absolute())
    for configuration in check_plan(plan):
        for stage in MADE:
            check_stage(stage, configuration, tree.staging)
    whole = whole_plan(tree, plan)
    filled = {split_of(plan, index) for index in range(min(plan.sequences, _COUNTED))}
    for name in (name for name, share in plan.splits.items() if share and name not in filled):
        say(f"splits: {name} is empty, by chance; more sequences or another seed fill it")
    with at_work(tree, whole):
        tree.write_plan(whole)
        failures = tree.read_failures()
        again = [index for index in sorted(failures) if index in range(whole.sequences)]
        wanted = again if retry else list(only) if only is not None else None
        there = set(tree.names())
        asked = range(plan.sequences) if wanted is None else wanted
        todo = [index for index in asked if sequence_name(index) not in there]
        try:
            _make_all(tree, plan, todo, failures, workers, scheduler)
        finally:
            tree.write_failures(failures)
    if failures:
        first = min(failures)
        raise UserError(
            f"{len(failures)} sequences failed, such as {sequence_name(first)}: {failures[first]}; "
            f"all are listed in {tree.failures}; use --retry to try them again"
        )
    return tree


def parse_indices(text: str, sequences: int) -> list[int]:
    """Parse numbers of sequences, such as "731" or "0-9,20". Raises UserError."""
    found: set[int] = set()
    for part in text.split(","):
        match = re.fullmatch(r"(\d+)(?:-(\d+))?", part.strip())
        if not match:
            raise UserError(f"--only {text}: {part!r}; give numbers such as 731 or 0-9,20")
        first, last = int(match[1]), int(match[2] or match[1])
        if not first <= last < sequences:
            raise UserError(
                f"--only {text}: the plan has sequences 0 to {sequences - 1}; give some of them"
            )
        found.update(range(first, last + 1))
    return sorted(found)


def _make_all(
    tree: Tree,
    plan: Plan,
    todo: list[int],
    failures: dict[int, str],
    workers: int | None,
    scheduler: str | None,
) -> None:
    if not todo:
        return
    _check_same_machinery(tree)
    job = partial(make_sequence, tree.root, plan)
    with closing(run_jobs("Making sequences", job, todo, workers, scheduler)) as outcomes:
        for outcome in outcomes:
            if outcome.ends_all:
                raise UserError(f"sequence {sequence_name(outcome.index)}: {outcome.problem}")
            failures.pop(outcome.index, None)
            if outcome.problem:
                failures[outcome.index] = outcome.problem
                say(f"sequence {sequence_name(outcome.index)} failed: {outcome.problem}")
                tree.write_failures(failures)


def whole_plan(tree: Tree, plan: Plan) -> Plan:
    """Return the plan of a folder: this one, with the largest number of sequences requested so far.

    Raises UserError for a folder of other files, or with sequences of another plan.
    """
    root = tree.root
    if not (root / "dataset.yaml").exists():
        refuse_others_folder(root)
        return plan
    former = tree.plan()
    old, new = (each.model_dump(mode="json") for each in (former, plan))
    if changes := differences({**old, "sequences": 0}, {**new, "sequences": 0}):
        raise UserError(
            f"{root} was made from another plan ({'; '.join(changes[:3])}); choose another folder "
            "(only the number of sequences may grow)"
        )
    for record in _some_records(tree):
        drawn = configuration_of(plan, record.index).model_dump(mode="json")
        if changes := differences(record.configuration, drawn):
            raise UserError(
                f"{root}: this plan or version of the program gives another sequence "
                f"{record.sequence} ({'; '.join(changes[:3])}); choose another folder"
            )
    return plan.model_copy(update={"sequences": max(former.sequences, plan.sequences)})


def _check_same_machinery(tree: Tree) -> None:
    """Refuse to add sequences by other models, libraries or variants than the existing ones."""
    for record in _some_records(tree):
        here = made_with(MADE, tree.dataset(record).configuration)
        changes = (
            f"{stage}: {change}"
            for stage in MADE
            if (change := provenance_changes(record.stages[stage].made_with, here[stage]))
        )
        if what := "; ".join(changes):
            raise UserError(
                f"{tree.root}: sequence {record.sequence} was made by other software "
                f"({what}); continue with that, choose another folder, or remove "
                f"{tree.records} to regenerate all"
            )


def _some_records(tree: Tree) -> Iterator[SequenceRecord]:
    names = tree.names()
    return map(tree.record, names[:: max(1, len(names) // _COMPARED)])


def make_sequence(root: Path, plan: Plan, index: int) -> None:
    """Make a sequence, or its missing output. Raises UserError and OSError."""
    tree, name = Tree(root), sequence_name(index)
    made = partial(_made, plan, index)
    Staged.of(tree, name).bring_in(configuration_of(plan, index), MADE, made)


def _made(plan: Plan, index: int, dataset: Dataset) -> SequenceRecord:
    data, configuration = dataset.root, dataset.configuration
    for stage in MADE:
        run_stage(data, configuration, stage)
    stages = Ledger(dataset).record.stages
    extra = hashes_of(data, write_flow_files(dataset, plan.flow_files))
    rendered = stages["render"]
    more = rendered.model_copy(update={"files": {**(rendered.files or {}), **extra}})
    return SequenceRecord(
        format=written("sequence"),
        sequence=configuration.name,
        stages={**stages, "render": more},
        index=index,
        split=split_of(plan, index),
        configuration=configuration.model_dump(mode="json"),
        statistics=sequence_statistics(dataset),
        poses=tuple(map(tuple, configuration.trajectory.poses().reshape(-1, 16).tolist())),
    )


def write_flow_files(dataset: Dataset, kinds: Sequence[FlowFile]) -> list[Path]:
    """Write forward flow, and the disparity of a stereo pair, in other layouts too.

    Return the folders.
    """
    settings = dataset.configuration
    frames = settings.trajectory.frames
    files = {_FLOW: frames - 1, _DISPARITY: frames if settings.stereo_with else 0}
    layouts = [each for each in _LAYOUTS if each[0] in kinds and files[each[1]]]
    for source, count in files.items():
        writers = [(folder, write) for _, of, folder, write in layouts if of == source]
        for index in range(count):
            places = [(dataset.frame(folder, index), write) for folder, write in writers]
            if missing := [each for each in places if not each[0].exists()]:
                found = READERS[source](dataset.frame(source, index))
                for path, write in missing:
                    write(path, found)
    return [dataset.root / folder / dataset.sequence for *_, folder, _ in layouts]


_FRAMES_LOOKED_AT = 8


def sequence_statistics(dataset: Dataset) -> SequenceStatistics:
    """Measure flow, depth and texture in a few evenly spaced frames, and all readings."""
    # among frames with a forward flow, unless there is only one
    last = max(dataset.configuration.trajectory.frames - 2, 0)
    frames = np.unique(np.linspace(0, last, min(_FRAMES_LOOKED_AT, last + 1)).astype(int)).tolist()
    speeds, unmatched, depths, sky, textures = [], [], [], [], []
    for index in frames:
        truth = read_truth_frame(dataset, index)
        flow, wraps = truth.flow_forward, dataset.configuration.camera.wraps
        speed = np.hypot(flow[..., 0], flow[..., 1])
        speeds.append(speed[~np.isnan(speed)])
        unmatched.append(np.mean(truth.occluded_forward | out_of_view(flow, wraps)))
        is_sky = np.isinf(truth.depth)
        sky.append(np.mean(is_sky))
        depths.append(truth.depth[~is_sky])
        textures.append(_texture(read_radiance_frame(dataset, index).sum(axis=-1)))
    speed, depth = np.concatenate(speeds), np.concatenate(depths)
    return SequenceStatistics(
        mean_speed_px=_rounded(speed.mean()) if speed.size else None,
        median_speed_px=_rounded(np.median(speed)) if speed.size else None,
        percentile_99_speed_px=_rounded(np.percentile(speed, 99)) if speed.size else None,
        unmatched_fraction=_rounded(np.mean(unmatched)),
        sky_fraction=_rounded(np.mean(sky)),
        median_depth_m=_rounded(np.median(depth)) if depth.size else None,
        texture=_rounded(np.mean(textures)),
        exposures=tuple(exposure_statistics(dataset)),
    )


def exposure_statistics(dataset: Dataset) -> Iterator[ExposureStatistics]:
    """Measure the readings of every sensor at every level."""
    for sensor, level in dataset.configuration.exposures:
        opened = open_exposure(dataset, sensor, level)
        yield ExposureStatistics(
            name=exposure_name(sensor, level),
            sensor=sensor.name,
            level=level,
            unit=sensor.unit,
            exposure_s=sensor.exposure_s,
            photons_per_pixel=_rounded(opened["photons"].mean()),
            mean_reading=_rounded(opened["counts"].mean()),
            saturated_fraction=_rounded(opened["saturated"].mean()),
        )


def _texture(light: NDArray[np.float32]) -> float:
    """RMS of the differences between neighbors, relative to the mean."""
    across, down = (np.diff(light.astype(np.float64), axis=axis).ravel() for axis in (1, 0))
    square = np.mean(np.square(np.concatenate([across, down])))
    return float(np.sqrt(square) / max(float(light.mean()), 1e-300))


def _rounded(value: float | np.floating) -> float:
    """Round to six digits: more would be noise."""
    return float(f"{float(value):.6g}")
