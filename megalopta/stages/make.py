"""Make the sequences of a plan, and add output to all sequences of a dataset."""

import math
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from megalopta.config import drawing
from megalopta.config.model import Configuration
from megalopta.config.recipe import FlowFile, Plan
from megalopta.config.yaml_model import validated
from megalopta.core import files
from megalopta.core.errors import UserError
from megalopta.core.folders import locked
from megalopta.core.progress import say, silent
from megalopta.core.record import Record
from megalopta.dataset.frames import read_radiance_frame, read_truth_frame
from megalopta.dataset.index import write_index
from megalopta.dataset.record import MADE, ExposureStatistics, SequenceStatistics
from megalopta.dataset.sintel import read_disparity, write_kitti_disparity
from megalopta.dataset.store import Dataset, Tree, exposure_name, hashes_of, open_sequence
from megalopta.flow.formats import read_flo, write_flo5, write_kitti_png
from megalopta.sensor import expectation
from megalopta.sensor.formats.products import ProductName, product_stem
from megalopta.stages.jobs import run_jobs
from megalopta.stages.noise_warning import light_note
from megalopta.stages.registry import STAGES, differences_text, provenance_changes
from megalopta.stages.run import check_stage, foresee, run, run_stage
from megalopta.stages.sense import expose, open_exposure

_FLOW, _DISPARITY = "training/flow", "training/disparities"
_LAYOUTS: tuple[tuple[FlowFile, str, str, Callable[[Path], Any], Callable[..., None]], ...] = (
    ("kitti_png", _FLOW, "training/flow_kitti", read_flo, write_kitti_png),
    ("flo5", _FLOW, "training/flow_flo5", read_flo, write_flo5),
    ("kitti_png", _DISPARITY, f"{_DISPARITY}_kitti", read_disparity, write_kitti_disparity),
)
"""Files in other layouts: folder of the source, folder, reader and writer"""


def make(
    root: Path,
    plan: Plan,
    *,
    only: Iterable[int] | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
) -> Tree:
    """Make the missing sequences of a plan, or `only` some of them.

    `workers` are processes of this machine, `scheduler` is the address of a Dask cluster; without
    both, all are made in this process. Raises UserError if the folder holds other files or
    sequences of another plan, if the machine refuses, such as a full disk, or, after all others are
    made, if sequences failed.
    """
    tree = Tree(root.absolute())
    for configuration in drawing.check_plan(plan):
        for stage in MADE:
            check_stage(stage, configuration, tree.root)
    plan_of_all = _whole_plan(tree, plan)
    for warning in drawing.plan_warnings(plan):
        say(warning)
    with locked(tree.root):
        tree.sweep()
        tree.write_header(plan=plan_of_all.model_dump(mode="json"))
        finished = set(tree.names()) - {
            path.stem for path in (tree.root / "sequences").glob("*.begun")
        }
        indices = range(plan.sequences) if only is None else only
        todo = [index for index in indices if drawing.sequence_name(index) not in finished]
        if finished:
            say(f"{root}: sequences kept: {len(finished)}, to make: {len(todo)}")
        if todo:
            _check_same_machinery(tree)
        try:
            _run("Making sequences", partial(_make, tree.root, plan), todo, workers, scheduler)
        finally:
            write_index(tree, plan_of_all)
        records = [tree.record(name) for name in _some(tree)] if todo else []
        if note := light_note(exposure for record in records for exposure in record.exposures):
            say(note)
        counted = [record for record in records if record.index % plan.cameras_per_path == 0]
        if len({len(record.exposures) for record in counted}) > 1:
            say("`megalopta sense` added exposures to earlier sequences; run it again for the new")
    return tree


def parse_indices(text: str, sequences: int) -> list[int]:
    """Parse numbers of sequences, such as "731" or "0-9,20". Raises UserError."""
    indices: set[int] = set()
    for part in text.split(","):
        match = re.fullmatch(r"(\d+)(?:-(\d+))?", part.strip())
        first, last = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
        if not first <= last < sequences:
            remedy = f"give some of 0 to {sequences - 1}, such as 731 or 0-9,20"
            raise UserError(f"--only {text}: {part!r}; {remedy}")
        indices.update(range(first, last + 1))
    return sorted(indices)


def _run(
    title: str,
    job: Callable[[int], object],
    indices: Collection[int],
    workers: int | None,
    scheduler: str | None,
) -> None:
    """Run a job for sequences; raise UserError at once if all would fail, else at the end."""
    failures: dict[int, str] = {}
    with closing(run_jobs(title, job, indices, workers, scheduler)) as outcomes:
        for outcome in outcomes:
            if outcome.problem:
                name = f"sequence {drawing.sequence_name(outcome.index)}"
                if outcome.ends_all:
                    raise UserError(f"{name}: {outcome.problem}")
                failures[outcome.index] = outcome.problem
                say(f"{name} failed: {outcome.problem}")
    if failures:
        first = min(failures)
        raise UserError(
            f"{len(failures)} of {len(indices)} sequences failed, such as "
            f"{drawing.sequence_name(first)}: {failures[first]}; once the cause is gone, the same "
            "command makes them"
        )


def _whole_plan(tree: Tree, plan: Plan) -> Plan:
    """Return the plan of a folder, with the most sequences requested so far; refuse another."""
    root = tree.root
    if not tree.exists():
        return plan
    if (former := tree.plan) is None:
        raise UserError(f"{root}: a dataset without a plan; choose another folder")
    old, new = ({**kept.model_dump(mode="json"), "sequences": 0} for kept in (former, plan))
    if changes := differences_text(old, new):
        raise UserError(
            f"{root} was made from another plan ({changes}); choose another folder (only sequences "
            "may be added here, and exposures by megalopta sense)"
        )
    fields = [field for stage in MADE for field in STAGES[stage].fields]  # not those of `flow`
    for record in map(tree.record, _some(tree)):
        drawn = drawing.configuration_of(plan, record.index).model_dump(mode="json")
        pair = ({key: of.get(key) for key in fields} for of in (record.configuration, drawn))
        if changes := differences_text(*pair):
            raise UserError(
                f"{root}: this plan or version of the program gives another sequence "
                f"{record.sequence} ({changes}); choose another folder"
            )
    return plan.model_copy(update={"sequences": max(former.sequences, plan.sequences)})


def _check_same_machinery(tree: Tree) -> None:
    """Refuse to add sequences by other models, libraries or variants than the existing ones."""
    for dataset in map(tree.opened, _some(tree)):
        for stage in MADE:
            before = dataset.former.stages[stage].made_with
            now = STAGES[stage].made_with(dataset.configuration)
            if change := provenance_changes(before, now):
                raise UserError(
                    f"{tree.root}: sequence {dataset.sequence} was made by other software "
                    f"({stage}: {change}); continue with that, choose another folder, or remove "
                    f"{dataset.record_path.parent} to regenerate all"
                )


def _some(tree: Tree) -> list[str]:
    """Finished sequences that are compared with the plan and with the software."""
    names = tree.names()
    return names[:: max(1, len(names) // 50)]


def _make(root: Path, plan: Plan, index: int) -> None:
    """Make a sequence, or its missing output. Raises UserError and OSError."""
    settings = drawing.configuration_of(plan, index)

    def more(made: Dataset) -> Mapping[str, Any]:
        write_flow_files(made, plan.flow_files)
        return {
            "index": index,
            "split": drawing.split_of(plan, index),
            "statistics": sequence_statistics(made),
            "poses": tuple(map(tuple, settings.trajectory.poses().reshape(-1, 16).tolist())),
        }

    dataset = Tree(root).at(settings)
    with silent():
        run(dataset, foresee(dataset, MADE), more)


def write_flow_files(dataset: Dataset, kinds: Sequence[FlowFile]) -> None:
    """Write forward flow, and the disparity of a stereo pair, in other layouts too."""
    settings = dataset.configuration
    frames = settings.trajectory.frames
    counts = {_FLOW: frames - 1, _DISPARITY: frames if settings.stereo_with else 0}
    for kind, source, folder, read, write in _LAYOUTS:
        for index in range(counts[source] if kind in kinds else 0):
            if not (path := dataset.frame(folder, index)).exists():
                write(path, read(dataset.frame(source, index)))


def sequence_statistics(dataset: Dataset) -> SequenceStatistics:
    """Measure flow, depth and texture in a few evenly spaced frames, and all readings."""
    from megalopta.render import out_of_view  # loads the renderer

    # among frames with a forward flow, unless there is only one
    last = max(dataset.configuration.trajectory.frames - 2, 0)
    frames = np.unique(np.linspace(0, last, min(8, last + 1)).astype(int)).tolist()
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
        light = read_radiance_frame(dataset, index).sum(axis=-1)
        steps = [np.diff(light.astype(np.float64), axis=axis).ravel() for axis in (1, 0)]
        rms = np.sqrt(np.mean(np.square(np.concatenate(steps))))
        textures.append(rms / max(float(light.mean()), 1e-300))
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
        opened, light = open_exposure(dataset, sensor, level), dict[str, float]()
        if dataset.configuration.expectation and sensor.unit != "events":
            bands_nm, shape = dataset.configuration.render.bands_nm, opened["photons"].shape[1:]
            dark = expectation(np.zeros((1, *shape, len(bands_nm))), bands_nm, sensor)
            events, variance = (opened[name].mean() for name in ("mean_events", "reading_variance"))
            reading = opened["mean_reading"].mean() - dark.mean_reading.mean()
            light["light_fraction"] = 1 - dark.mean_events.mean() / max(events, 1e-300)
            light["snr"] = reading / math.sqrt(max(variance, 1e-300))
        yield ExposureStatistics(
            name=exposure_name(sensor, level),
            sensor=sensor.name,
            level=level,
            unit=sensor.unit,
            exposure_s=sensor.exposure_s,
            photons_per_pixel=_rounded(opened["photons"].mean()),
            mean_reading=_rounded(opened["counts"].mean()),
            saturated_fraction=_rounded(opened["saturated"].mean()),
            **{name: _rounded(value) for name, value in light.items()},
        )


def _rounded(value: float | np.floating) -> float:
    """Round to six digits: more would be noise."""
    return float(f"{float(value):.6g}")


def measure(
    root: Path,
    stage: str,
    overrides: Mapping[str, str],
    redo: bool = False,
    workers: int | None = None,
    scheduler: str | None = None,
) -> None:
    """Run a stage on every sequence, with changes of its settings.

    Raises UserError, before anything is changed, if a setting concerns an earlier stage, or if the
    stage has run with other settings and `redo` is not set.
    """
    tree = Tree(root.absolute())
    if tree.plan is not None:
        job = partial(_measure, tree.root, overrides, stage, redo)
        _on_all(tree, f"Measuring sequences ({stage})", job, workers, scheduler)
        return
    values = open_sequence(tree.root).configuration.model_dump(mode="json")
    run_stage(root, validated(Configuration, values, str(root), overrides), stage, redo)


def _on_all(
    tree: Tree, title: str, job: Callable[..., object], workers: int | None, scheduler: str | None
) -> None:
    """Do a job on every sequence of a plan, after each `is_checked`, and renew the index."""
    plan = tree.plan
    assert plan is not None
    with locked(tree.root):
        tree.sweep()
        indices = [tree.record(name).index for name in tree.names()]
        with silent():
            for index in indices:
                job(index, is_checked=True)
        try:
            _run(title, partial(job, is_checked=False), indices, workers, scheduler)
        finally:
            write_index(tree, plan)


def _measure(
    root: Path, overrides: Mapping[str, str], stage: str, redo: bool, index: int, is_checked: bool
) -> None:
    made = Tree(root).opened(drawing.sequence_name(index))
    values = made.configuration.model_dump(mode="json")
    settings = validated(Configuration, values, str(root), overrides)
    dataset = replace(made, configuration=settings)
    with silent():
        work = foresee(dataset, (stage,), redo)
        if is_checked:
            check_stage(stage, settings, root)
        else:
            run(dataset, work)


class Exposing(Record, frozen=True):
    """Exposures to add to a dataset."""

    sensors: Annotated[tuple[str | dict[str, Any], ...], Field(min_length=1)] = ("spadcam",)
    """Sensors, as in a configuration: presets' names, or `{preset: spadcam, exposure_s: 0.01}`"""
    light_levels: Annotated[tuple[str | float, ...], Field(min_length=1)] = ("twilight",)
    """Levels, by name or in lux"""
    repeats: Annotated[int, Field(ge=1, le=1000)] = 1
    """Of a dataset of many: exposures of each, with independent noise; later ones are SENSOR-r2,
    SENSOR-r3, …"""
    products: tuple[ProductName, ...] = ("counts",)
    """Output of each, as in a configuration"""


def add_exposures(
    root: Path,
    overrides: Mapping[str, str],
    workers: int | None = None,
    scheduler: str | None = None,
) -> None:
    """Add missing exposures, by the fields of `Exposing`, to every sequence of a plan.

    Raises UserError if there is no dataset, or a sensor cannot expose a sequence.
    """
    tree = Tree(root.absolute())
    job = partial(_expose, tree.root, validated(Exposing, {}, "sense", overrides))
    _on_all(tree, "Exposing sequences", job, workers, scheduler)


def _expose(root: Path, exposing: Exposing, index: int, is_checked: bool) -> None:
    """Add missing exposures to a sequence; its record lists them when all are complete."""
    made = Tree(root).opened(drawing.sequence_name(index))
    record = made.former
    values = {
        **made.configuration.model_dump(mode="json"),
        **exposing.model_dump(mode="json", exclude={"repeats"}),
    }
    settings = drawing.repeated(validated(Configuration, values, "sense"), exposing.repeats)
    wanted = replace(made, configuration=settings)
    missing = []
    for sensor, level in settings.exposures:
        name = exposure_name(sensor, level)
        if name not in made.exposures:
            missing.append(name)
        elif open_exposure(wanted, sensor, level).sensor != sensor:
            raise UserError(
                f"{name} exists with other settings; give the sensor another name, such as "
                "{preset: spadcam, name: fast, exposure_s: 0.01}"
            )
    if is_checked:
        check_stage("sense", settings, root)
        model = STAGES["sense"].made_with(settings)["model"]
        if (known := record.stages["sense"].made_with["model"]) != model:
            raise UserError(
                f"{root}: sequence {made.sequence} was exposed by another sensor model (sense: "
                f"model: {known} → {model}); use the program that made it, or regenerate the "
                "dataset in another folder"
            )
        return
    if not missing:
        return
    folders = [root / kind / made.sequence for kind in ("counts", "corrected")]
    with locked(made.record_path.parent, f".{made.sequence}.lock"), silent():
        for path in [path for folder in folders for path in folder.glob("*")]:  # of a killed run
            if product_stem(path) not in made.exposures:
                files.remove(path)
        expose(wanted)
        listed, sensed = record.files, record.stages["sense"]
        products = files.files_in(folders)
        added = [path for path in products if str(path.relative_to(root)) not in listed]
        files_of = {**(sensed.files or {}), **hashes_of(root, added)}
        assert record.statistics is not None
        measured = exposure_statistics(replace(wanted, record=None))
        new = (exposure for exposure in measured if exposure.name in missing)
        exposures = *record.exposures, *new
        update = {
            "statistics": record.statistics.model_copy(update={"exposures": exposures}),
            "stages": {**record.stages, "sense": sensed.model_copy(update={"files": files_of})},
        }
        files.write_text(made.record_path, record.model_copy(update=update).to_json())
