"""New light on sequences that are made: other sensors, exposures and levels, nothing rendered.

The stores are made beside the tree, as sequences are; a sequence's record names them when they are
all there.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from functools import partial
from itertools import product
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from megalopta.config.drawing import repeated, sequence_name
from megalopta.config.model import Configuration
from megalopta.config.yaml_model import validated
from megalopta.core import files
from megalopta.core.errors import UserError
from megalopta.core.folders import locked
from megalopta.core.format_numbers import written
from megalopta.core.progress import progress, silent
from megalopta.core.record import Record
from megalopta.dataset.books import write_index
from megalopta.dataset.layout import Tree
from megalopta.dataset.record import SequenceRecord
from megalopta.dataset.store import Dataset, file_hash, hashes_of
from megalopta.generation.attempt import Outcome
from megalopta.generation.jobs import run_jobs
from megalopta.generation.staging import (
    EXPOSED,
    begin,
    clear,
    finish,
    publish,
    settle,
    tidy,
)
from megalopta.generation.statistics import exposure_statistics
from megalopta.sensor.formats import ProductName, product_stem
from megalopta.stages.pipeline import check_stage
from megalopta.stages.registry import STAGES
from megalopta.stages.sense import open_exposure


class Exposing(Record, frozen=True):
    """What to expose on the light of a dataset."""

    sensors: Annotated[tuple[str | dict[str, Any], ...], Field(min_length=1)] = ("spadcam",)
    """Sensors, as in a configuration: presets' names, or `{preset: spadcam, exposure_s: 0.01}`"""

    light_levels: Annotated[tuple[str | float, ...], Field(min_length=1)] = ("twilight",)
    """Levels, by name or in lux"""

    repeats: Annotated[int, Field(ge=1, le=1000)] = 1
    """Exposures of each, with independent noise; later ones are of SENSOR-r2, SENSOR-r3, …"""

    products: tuple[ProductName, ...] = ("counts",)
    """What is written of each, as in a configuration"""


def load_exposing(overrides: Mapping[str, str]) -> Exposing:
    """What to expose, from settings of the command line. Raises UserError."""
    return validated(Exposing, {}, "dataset expose", overrides)


def expose(
    root: Path, wanted: Exposing, workers: int | None = None, scheduler: str | None = None
) -> Tree:
    """Expose what is not there yet, on every finished sequence.

    Raises
    ------
    UserError
        When there is no dataset, or a sensor cannot expose a sequence.
    """
    tree = Tree(root.absolute())
    plan = tree.plan()
    index = partial(write_index, tree, plan)
    with locked(tree.root):
        tidy(tree, keep_exposures=True)
        settle(tree, index)
        indices = [_checked(tree, name, wanted) for name in tree.names()]
        job = partial(expose_sequence, tree.root, wanted)
        with (
            progress("Exposing sequences", len(indices), "sequence") as advance,
            closing(run_jobs(job, indices, workers, scheduler)) as outcomes,
        ):
            problems = _problems(outcomes, advance)
        index()
        tidy(tree, keep_exposures=bool(problems))
    if problems:
        raise UserError(problems[0])
    return tree


def _checked(tree: Tree, name: str, wanted: Exposing) -> int:
    """Return the number of a sequence, if this sensor model exposed it before.

    Libraries may be others, as where a dataset was downloaded: new exposures stand for themselves.
    Raises UserError.
    """
    record, model = tree.record(name), STAGES["sense"].model()
    known = record.stages["sense"].made_with.get("model", model)
    if known != model:
        raise UserError(
            f"{tree.root}: sequence {name} was exposed otherwise than it would be here (sense: "
            f"model: {known} → {model}); expose it with what made it, or make the dataset again in "
            "another folder"
        )
    tree.dataset(record)  # refuses settings that are damaged
    _configuration(record, wanted)
    return record.index


def _problems(outcomes: Iterator[Outcome], advance: Callable[[], None]) -> list[str]:
    """The first problem that there is; after it nothing is begun."""
    for outcome in outcomes:
        if outcome.problem:
            return [f"sequence {sequence_name(outcome.index)}: {outcome.problem}"]
        advance()
    return []


def expose_sequence(root: Path, wanted: Exposing, index: int) -> None:
    """Expose what is not there yet on one sequence."""
    tree, name = Tree(root), sequence_name(index)
    staged = tree.staging / f"{name}{EXPOSED}"
    with locked(staged), silent():
        record = tree.record(name)
        settings = _configuration(record, wanted)
        if _new(tree, record, settings):
            _expose(tree, record, Dataset(begin(staged, settings), settings))
            publish(tree, staged, name)
        clear(staged)


def _expose(tree: Tree, record: SequenceRecord, dataset: Dataset) -> None:
    check_stage("sense", dataset.configuration, dataset.root)
    name = record.sequence
    _link_light(tree, record, dataset)
    STAGES["sense"].work(dataset)
    made = [each for each in exposure_statistics(dataset) if each.name not in _known(record)]
    for path in sorted((dataset.root / "counts" / name).iterdir()):
        if product_stem(path) in _known(record):
            files.remove(path)
    hashes = hashes_of(dataset.root, [dataset.root / "counts" / name])
    sensed = record.stages["sense"]
    more = sensed.model_copy(update={"files": {**(sensed.files or {}), **hashes}})
    assert record.statistics is not None
    statistics = record.statistics.model_copy(update={"exposures": (*record.exposures, *made)})
    changes = {
        "format": written("sequence"),
        "replaced": file_hash(tree.record_path(name)),
        "statistics": statistics,
        "stages": {**record.stages, "sense": more},
    }
    finish(dataset.root.parent, record.model_copy(update=changes))


def _link_light(tree: Tree, record: SequenceRecord, dataset: Dataset) -> None:
    """Link the rendered light to where it is exposed, after comparing it with the record."""
    whole = tree.dataset(record)
    whole.read_scene_record()
    for index in range(whole.configuration.trajectory.frames):
        whole.exposed_radiance(index)
    for kind in ("radiance", "radiance_shutter"):
        link = dataset.root / kind / record.sequence
        if (tree.root / kind / record.sequence).is_dir() and not link.is_symlink():
            link.parent.mkdir(parents=True, exist_ok=True)
            # relative, so that a dataset may be moved meanwhile
            light = Path("../../../..") / kind / record.sequence
            link.symlink_to(light, target_is_directory=True)


def _configuration(record: SequenceRecord, wanted: Exposing) -> Configuration:
    values = {**record.configuration, **wanted.model_dump(mode="json", exclude={"repeats"})}
    return repeated(validated(Configuration, values, "dataset expose"), wanted.repeats)


def _new(tree: Tree, record: SequenceRecord, wanted: Configuration) -> list[str]:
    """Names of exposures that are not there yet. Raises UserError for a name that is taken."""
    names = []
    there = tree.dataset(record)
    for sensor, level in product(wanted.sensors, wanted.light_levels):
        path = there.counts(sensor, level)
        if path.stem not in _known(record):
            names.append(path.stem)
        elif open_exposure(there, sensor, level).sensor != sensor:
            raise UserError(
                f"{path.stem} is there with other settings; give the sensor a name of its own, "
                f"such as {{preset: spadcam, name: fast, exposure_s: 0.01}}"
            )
    return names


def _known(record: SequenceRecord) -> set[str]:
    return {each.name for each in record.exposures}
