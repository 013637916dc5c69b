"""New light on sequences that are made: other sensors, exposures and levels, nothing rendered."""

from collections.abc import Mapping
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
from megalopta.core.record import Record
from megalopta.dataset.layout import Tree
from megalopta.dataset.record import SequenceRecord
from megalopta.dataset.store import Dataset, hashes_of
from megalopta.generation.extending import extend, extend_sequence
from megalopta.generation.statistics import exposure_statistics
from megalopta.sensor.formats.names import ProductName, product_stem
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
    job = partial(expose_sequence, tree.root, wanted)
    check = partial(_check, tree, wanted)
    return extend(tree, "Exposing sequences", check, job, workers, scheduler)


def _check(tree: Tree, wanted: Exposing, record: SequenceRecord) -> None:
    """Refuse a sequence that another sensor model exposed before.

    Libraries may be others, as where a dataset was downloaded: new exposures stand for themselves.
    Raises UserError.
    """
    model = STAGES["sense"].model()
    known = record.stages["sense"].made_with.get("model", model)
    if known != model:
        raise UserError(
            f"{tree.root}: sequence {record.sequence} was exposed otherwise than it would be here "
            f"(sense: model: {known} → {model}); expose it with what made it, or make the dataset "
            "again in another folder"
        )
    tree.dataset(record)  # refuses settings that are damaged
    _configuration(record, wanted)


def expose_sequence(root: Path, wanted: Exposing, index: int) -> None:
    """Expose what is not there yet on one sequence."""
    tree = Tree(root)
    record = tree.record(sequence_name(index))
    settings = _configuration(record, wanted)
    if _new(tree, record, settings):
        check_stage("sense", settings, root)
        kinds = ("radiance", "radiance_shutter")
        extend_sequence(tree, record, "sense", settings, kinds, partial(_exposed, record))


def _exposed(record: SequenceRecord, dataset: Dataset) -> SequenceRecord:
    """Expose what is not known yet, and return the record with it."""
    STAGES["sense"].work(dataset)
    made = [each for each in exposure_statistics(dataset) if each.name not in _known(record)]
    counts = dataset.root / "counts" / record.sequence
    for path in sorted(counts.iterdir()):
        if product_stem(path) in _known(record):
            files.remove(path)
    sensed = record.stages["sense"]
    hashes = {**(sensed.files or {}), **hashes_of(dataset.root, [counts])}
    more = sensed.model_copy(update={"files": hashes})
    assert record.statistics is not None
    statistics = record.statistics.model_copy(update={"exposures": (*record.exposures, *made)})
    changes = {"statistics": statistics, "stages": {**record.stages, "sense": more}}
    return record.model_copy(update=changes)


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
