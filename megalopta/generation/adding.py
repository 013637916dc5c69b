"""Add output to finished sequences: new exposures, or a stage's measurements.

Output is made outside the tree, as sequences are, from links to existing files; a sequence's record
names it when it is complete.
"""

from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeAlias

from pydantic import Field

from megalopta.config.drawing import repeated, sequence_name
from megalopta.config.model import Configuration, differences
from megalopta.config.yaml_model import validated
from megalopta.core import files
from megalopta.core.errors import UserError
from megalopta.core.format_numbers import written
from megalopta.core.progress import say
from megalopta.core.record import Record
from megalopta.dataset.layout import Tree
from megalopta.dataset.publishing import link
from megalopta.dataset.record import SequenceRecord
from megalopta.dataset.store import Dataset, file_hash, hashes_of
from megalopta.generation.jobs import run_jobs
from megalopta.generation.making import exposure_statistics
from megalopta.generation.staging import Staged, at_work
from megalopta.sensor.formats.products import ProductName, product_stem
from megalopta.stages.ledger import Ledger, stage_record
from megalopta.stages.pipeline import check_stage
from megalopta.stages.registry import STAGES, stage_configuration
from megalopta.stages.sense import open_exposure


@dataclass(frozen=True)
class _Measured:
    """Measurement by a stage, such as flow."""

    stage: str
    overrides: Mapping[str, str]
    redo: bool

    def wanted(self, made: Dataset) -> Dataset:
        """Return a sequence with the settings of the measurement. Raises UserError."""
        stored = made.configuration.model_dump(mode="json")
        settings = validated(Configuration, stored, str(made.record_path), self.overrides)
        return replace(made, configuration=settings)

    def check(self, made: Dataset, wanted: Dataset) -> str | None:
        """Refuse a sequence that it cannot be added to; return a message, if any."""
        stage, ledger = self.stage, Ledger(wanted)
        for earlier in STAGES[stage].needs:
            before, now = (
                stage_configuration(each.configuration, earlier) for each in (made, wanted)
            )
            if changes := differences(before, now):
                raise UserError(
                    f"{made.root}: {changes[0]} would change {earlier!r} output; {stage} "
                    f"takes only its own settings: {', '.join(STAGES[stage].fields)}"
                )
        if stage in ledger.record.stages and not ledger.entry(stage) and not self.redo:
            raise UserError(
                f"{made.root}: sequence {made.sequence} holds {stage} output of other "
                "settings; add --redo to replace it"
            )
        note = f"{stage}: made by another version of the program; recomputing"
        return note if ledger.is_outdated(stage) and not self.redo else None

    def is_there(self, wanted: Dataset) -> bool:
        """True if a sequence already has it."""
        ledger = Ledger(wanted)
        is_current = ledger.is_finished(self.stage) and not ledger.is_outdated(self.stage)
        return is_current and not self.redo

    def entered(self, record: SequenceRecord, dataset: Dataset) -> SequenceRecord:
        """Return a sequence's record with the new output."""
        entry = stage_record(dataset, self.stage, STAGES[self.stage].outputs(dataset))
        return record.model_copy(update={"stages": {**record.stages, self.stage: entry}})


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


@dataclass(frozen=True)
class _Exposed:
    """Exposures by other sensors, times and levels, without rendering."""

    exposing: Exposing
    stage: ClassVar = "sense"

    def wanted(self, made: Dataset) -> Dataset:
        values = {
            **made.configuration.model_dump(mode="json"),
            **self.exposing.model_dump(mode="json", exclude={"repeats"}),
            "imu": None,  # it is there
        }
        settings = validated(Configuration, values, "sense")
        return replace(made, configuration=repeated(settings, self.exposing.repeats))

    def check(self, made: Dataset, wanted: Dataset) -> None:
        """Refuse a sequence that another sensor model exposed before.

        Libraries may differ, as after a download of a dataset: new exposures are independent of the
        old ones.
        """
        model = STAGES["sense"].model()
        known = Ledger(made).record.stages["sense"].made_with.get("model", model)
        if known != model:
            raise UserError(
                f"{made.root}: sequence {made.sequence} was exposed by another sensor model "
                f"(sense: model: {known} → {model}); use the program that made it, or regenerate "
                "the dataset in another folder"
            )

    def is_there(self, wanted: Dataset) -> bool:
        """Raise UserError for a name that other settings use."""
        is_missing = False
        for sensor, level in wanted.configuration.exposures:
            path = wanted.counts(sensor, level)
            if path.stem not in wanted.exposures:
                is_missing = True
            elif open_exposure(wanted, sensor, level).sensor != sensor:
                raise UserError(
                    f"{path.stem} exists with other settings; give the sensor another name, "
                    f"such as {{preset: spadcam, name: fast, exposure_s: 0.01}}"
                )
        return not is_missing

    def entered(self, record: SequenceRecord, dataset: Dataset) -> SequenceRecord:
        known = {each.name for each in record.exposures}
        made = [each for each in exposure_statistics(dataset) if each.name not in known]
        folders = [dataset.root / kind / record.sequence for kind in ("counts", "corrected")]
        for path in sorted(path for folder in folders for path in folder.glob("*")):
            if product_stem(path) in known:
                files.remove(path)
        sensed = record.stages["sense"]
        hashes = {**(sensed.files or {}), **hashes_of(dataset.root, folders)}
        stages = {**record.stages, "sense": sensed.model_copy(update={"files": hashes})}
        assert record.statistics is not None
        exposures = (*record.exposures, *made)
        statistics = record.statistics.model_copy(update={"exposures": exposures})
        return record.model_copy(update={"statistics": statistics, "stages": stages})


Addition: TypeAlias = _Measured | _Exposed
"""Output of a stage to add to every sequence; picklable."""


def add_to_all(
    root: Path,
    addition: Addition,
    title: str,
    workers: int | None = None,
    scheduler: str | None = None,
) -> Tree:
    """Add to every finished sequence, after checking all, and rebuild the index.

    Raises UserError if there is no dataset of many sequences, or a check or a sequence fails.
    """
    tree = Tree(root.absolute())
    with at_work(tree, tree.plan(), keep_added=True) as problems:
        indices, notes = [], set()
        for record in map(tree.record, tree.names()):
            made = tree.dataset(record)
            wanted = addition.wanted(made)
            notes.add(addition.check(made, wanted))
            check_stage(addition.stage, wanted.configuration, tree.staging)
            indices.append(record.index)
        for note in sorted(filter(None, notes)):
            say(note)
        job = partial(add_to_sequence, tree.root, addition)
        with closing(run_jobs(title, job, indices, workers, scheduler)) as outcomes:
            if failed := next((each for each in outcomes if each.problem), None):
                problems.append(f"sequence {sequence_name(failed.index)}: {failed.problem}")
    if problems:
        raise UserError(problems[0])
    return tree


def add_to_sequence(root: Path, addition: Addition, index: int) -> None:
    """Add missing output to one sequence."""
    tree, name = Tree(root), sequence_name(index)
    record = tree.record(name)
    made = tree.dataset(record)
    wanted = addition.wanted(made)
    if not addition.is_there(wanted):
        work = partial(_added, addition, made, record)
        Staged.of(tree, name, is_added=True).bring_in(wanted.configuration, [addition.stage], work)


def _added(
    addition: Addition, made: Dataset, record: SequenceRecord, dataset: Dataset
) -> SequenceRecord:
    """Run a stage next to links to the output that it needs, which is compared with the record."""
    stage = STAGES[addition.stage]
    needed = record.model_copy(update={"stages": {n: record.stages[n] for n in stage.needs}})
    for folder in needed.folders:  # no stage reads those in training/
        if not (folder.startswith("training/") or (dataset.root / folder).is_symlink()):
            link(made.root, dataset.root, folder)
    linked = replace(dataset, record=needed)
    for kind in ("counts", "corrected"):  # frames are compared as a stage reads them
        linked.compare_all(f"{kind}/{record.sequence}/")
    stage.work(linked)
    before = {"format": written("sequence"), "replaced": file_hash(made.record_path)}
    return addition.entered(record, dataset).model_copy(update=before)


def measure(
    root: Path,
    stage: str,
    overrides: Mapping[str, str],
    redo: bool = False,
    workers: int | None = None,
    scheduler: str | None = None,
) -> Tree:
    """Run a stage on every finished sequence that lacks it.

    Measurements by another version of the program are recomputed. Raises UserError if a setting
    concerns an earlier stage, or the stage has run with other settings and `redo` is not set.
    """
    title = f"Measuring sequences ({stage})"
    return add_to_all(root, _Measured(stage, overrides, redo), title, workers, scheduler)


def add_exposures(
    root: Path,
    wanted: Exposing | Mapping[str, str],
    workers: int | None = None,
    scheduler: str | None = None,
) -> Tree:
    """Add missing exposures to every finished sequence.

    `wanted` may also be settings of the command line. Raises UserError if there is no dataset, or a
    sensor cannot expose a sequence.
    """
    if not isinstance(wanted, Exposing):
        wanted = validated(Exposing, {}, "sense", wanted)
    return add_to_all(root, _Exposed(wanted), "Exposing sequences", workers, scheduler)
