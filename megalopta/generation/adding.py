"""Add output to finished sequences: new exposures, or a stage's measurements.

Output is made outside the tree, as sequences are, from links to existing files; a sequence's record
names it when it is complete.
"""

from collections.abc import Collection, Mapping
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeAlias

from pydantic import Field

from megalopta.config.drawing import repeated, sequence_name
from megalopta.config.model import Configuration, differences, parse
from megalopta.config.yaml_model import to_yaml, validated
from megalopta.core import files
from megalopta.core.errors import UserError
from megalopta.core.format_numbers import written
from megalopta.core.progress import progress, say
from megalopta.core.record import Record
from megalopta.dataset.layout import Tree
from megalopta.dataset.publishing import link
from megalopta.dataset.record import KINDS, SequenceRecord
from megalopta.dataset.store import Dataset, file_hash, hashes_of
from megalopta.generation.jobs import Job, run_jobs
from megalopta.generation.making import exposure_statistics
from megalopta.generation.staging import Staged, at_work
from megalopta.sensor.formats.products import ProductName, product_stem
from megalopta.stages.ledger import Ledger, stage_hash, stage_record
from megalopta.stages.pipeline import check_stage
from megalopta.stages.registry import STAGES, stage_configuration
from megalopta.stages.sense import open_exposure


@dataclass(frozen=True)
class _Measured:
    """Measurement by a stage, such as flow."""

    stage: str
    overrides: Mapping[str, str]
    redo: bool
    kinds: ClassVar = tuple(kind for kind in KINDS if kind != "results")

    def settings(self, tree: Tree, record: SequenceRecord) -> Configuration:
        """Return its settings. Raises UserError."""
        stored = to_yaml(tree.dataset(record).configuration)
        return parse(stored, str(tree.record_path(record.sequence)), self.overrides)

    def check(self, tree: Tree, record: SequenceRecord) -> str | None:
        """Refuse a sequence that it cannot be added to; return a message, if any."""
        settings, made = self.settings(tree, record), tree.dataset(record).configuration
        for earlier in STAGES[self.stage].needs:
            before, now = (stage_configuration(each, earlier) for each in (made, settings))
            if changes := differences(before, now):
                raise UserError(
                    f"{tree.root}: {changes[0]} would change {earlier!r} output; {self.stage} "
                    f"takes only its own settings: {', '.join(STAGES[self.stage].fields)}"
                )
        there = record.stages.get(self.stage)
        if there and there.settings != stage_hash(settings, self.stage) and not self.redo:
            raise UserError(
                f"{tree.root}: sequence {record.sequence} holds {self.stage} output of other "
                "settings; add --redo to replace it"
            )
        check_stage(self.stage, settings, tree.staging)
        is_outdated = Ledger(Dataset(tree.root, settings)).is_outdated(self.stage)
        note = f"{self.stage}: made by another version of the program; recomputing"
        return note if is_outdated and not self.redo else None

    def is_there(self, tree: Tree, record: SequenceRecord) -> bool:
        """True if a sequence already has it."""
        ledger = Ledger(Dataset(tree.root, self.settings(tree, record)))
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
    """Exposures of each, with independent noise; later ones are SENSOR-r2, SENSOR-r3, …"""

    products: tuple[ProductName, ...] = ("counts",)
    """Output of each, as in a configuration"""


@dataclass(frozen=True)
class _Exposed:
    """Exposures by other sensors, times and levels, without rendering."""

    wanted: Exposing
    stage: ClassVar = "sense"
    kinds: ClassVar = ("radiance", "radiance_shutter")

    def settings(self, tree: Tree, record: SequenceRecord) -> Configuration:
        values = {
            **record.configuration,
            **self.wanted.model_dump(mode="json", exclude={"repeats"}),
            "imu": None,  # it is there
        }
        return repeated(validated(Configuration, values, "dataset expose"), self.wanted.repeats)

    def check(self, tree: Tree, record: SequenceRecord) -> None:
        """Refuse a sequence that another sensor model exposed before.

        Libraries may differ, as after a download of a dataset: new exposures are independent of the
        old ones.
        """
        model = STAGES["sense"].model()
        known = record.stages["sense"].made_with.get("model", model)
        if known != model:
            raise UserError(
                f"{tree.root}: sequence {record.sequence} was exposed by another sensor model "
                f"(sense: model: {known} → {model}); use the program that made it, or regenerate "
                "the dataset in another folder"
            )
        tree.dataset(record)  # refuses damaged settings
        check_stage(self.stage, self.settings(tree, record), tree.staging)

    def is_there(self, tree: Tree, record: SequenceRecord) -> bool:
        """Raise UserError for a name that other settings use."""
        there, settings, known = tree.dataset(record), self.settings(tree, record), _known(record)
        missing = []
        for sensor, level in settings.exposures:
            path = there.counts(sensor, level)
            if path.stem not in known:
                missing.append(path.stem)
            elif open_exposure(there, sensor, level).sensor != sensor:
                raise UserError(
                    f"{path.stem} exists with other settings; give the sensor another name, "
                    f"such as {{preset: spadcam, name: fast, exposure_s: 0.01}}"
                )
        return not missing

    def entered(self, record: SequenceRecord, dataset: Dataset) -> SequenceRecord:
        known = _known(record)
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


def _known(record: SequenceRecord) -> set[str]:
    return {each.name for each in record.exposures}


Addition: TypeAlias = _Measured | _Exposed
"""Output of a stage to add to every sequence, made from folders of some kinds; picklable."""


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
        records = map(tree.record, tree.names())
        checked = [(record.index, addition.check(tree, record)) for record in records]
        for note in sorted({each for _, each in checked if each}):
            say(note)
        job = partial(add_to_sequence, tree.root, addition)
        problems += _problems(job, [index for index, _ in checked], title, workers, scheduler)
    if problems:
        raise UserError(problems[0])
    return tree


def add_to_sequence(root: Path, addition: Addition, index: int) -> None:
    """Add missing output to one sequence."""
    tree, name = Tree(root), sequence_name(index)
    record = tree.record(name)
    if not addition.is_there(tree, record):
        settings, made = addition.settings(tree, record), partial(_added, tree, record, addition)
        Staged.of(tree, name, is_added=True).bring_in(settings, [addition.stage], made)


def _added(
    tree: Tree, record: SequenceRecord, addition: Addition, dataset: Dataset
) -> SequenceRecord:
    _link(tree, record, dataset, addition.kinds)
    STAGES[addition.stage].work(dataset)
    before = {
        "format": written("sequence"),
        "replaced": file_hash(tree.record_path(record.sequence)),
    }
    return addition.entered(record, dataset).model_copy(update=before)


def _problems(
    job: Job, indices: Collection[int], title: str, workers: int | None, scheduler: str | None
) -> list[str]:
    """Return the first problem, if any; after it nothing is begun."""
    with (
        progress(title, len(indices), "sequence") as advance,
        closing(run_jobs(job, indices, workers, scheduler)) as outcomes,
    ):
        for outcome in outcomes:
            if outcome.problem:
                return [f"sequence {sequence_name(outcome.index)}: {outcome.problem}"]
            advance()
    return []


def _link(tree: Tree, record: SequenceRecord, dataset: Dataset, kinds: Collection[str]) -> None:
    """Link existing output to where it is read, after comparing it with the record."""
    whole, name = tree.dataset(record), record.sequence
    for folder in (f"{kind}/{name}" for kind in kinds):
        whole.compare_all(f"{folder}/")
        if (tree.root / folder).is_dir() and not (dataset.root / folder).is_symlink():
            link(tree.root, dataset.root, folder)


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
        wanted = validated(Exposing, {}, "dataset expose", wanted)
    return add_to_all(root, _Exposed(wanted), "Exposing sequences", workers, scheduler)
