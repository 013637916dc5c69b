"""New light on sequences that are made: other sensors, exposures and levels, nothing rendered.

The stores are made beside the tree, as sequences are; a sequence's record names them when they are
all there.
"""

from collections.abc import Mapping
from contextlib import closing
from functools import partial
from itertools import product
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from megalopta import files
from megalopta.config import Configuration, validated
from megalopta.dataset import Dataset
from megalopta.engine import run_jobs
from megalopta.errors import UserError
from megalopta.folders import locked
from megalopta.making.sequence import file_hashes
from megalopta.making.statistics import exposure_statistics
from megalopta.plan import repeated, sequence_name
from megalopta.progress import progress, silent
from megalopta.record import Record
from megalopta.sensor.formats import ProductName, product_stem
from megalopta.stages import STAGES, check_stage, open_exposure
from megalopta.tree import SequenceRecord, Tree, write_index


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
    with locked(tree.root):
        indices = [tree.record(name).index for name in tree.names()]
        job = partial(expose_sequence, tree.root, wanted)
        with (
            progress("Exposing sequences", len(indices), "sequence") as advance,
            closing(run_jobs(job, indices, workers, scheduler)) as outcomes,
        ):
            for outcome in outcomes:
                if outcome.problem:
                    name = sequence_name(outcome.index)
                    raise UserError(f"sequence {name}: {outcome.problem}")
                advance()
        write_index(tree, plan)
        tree.clear_staging()
    return tree


def expose_sequence(root: Path, wanted: Exposing, index: int) -> None:
    """Expose what is not there yet on one sequence."""
    tree, name = Tree(root), sequence_name(index)
    staged = tree.staging / f"{name}-exposed"
    with locked(staged), silent():
        record = tree.record(name)
        dataset = Dataset(staged / "data", _configuration(record, wanted))
        if _new(tree, record, dataset.configuration):
            _expose(tree, record, dataset)
        files.remove(dataset.root)


def _expose(tree: Tree, record: SequenceRecord, dataset: Dataset) -> None:
    check_stage("sense", dataset.configuration, dataset.root)
    name = record.sequence
    for kind in ("radiance", "radiance_shutter"):
        link = dataset.root / kind / name
        if (tree.root / kind / name).is_dir() and not link.is_symlink():
            link.parent.mkdir(parents=True, exist_ok=True)
            link.symlink_to(tree.root / kind / name, target_is_directory=True)
    files.sweep(dataset.root / "counts")
    STAGES["sense"].work(dataset)
    made = [each for each in exposure_statistics(dataset) if each.name not in _known(record)]
    source, target = (each / "counts" / name for each in (dataset.root, tree.root))
    paths = [path for path in sorted(source.iterdir()) if product_stem(path) not in _known(record)]
    hashes = file_hashes(dataset.root, paths)
    for path in paths:
        files.remove(target / path.name)
        path.rename(target / path.name)
    statistics = record.statistics.model_copy(
        update={"exposures": (*record.statistics.exposures, *made)}
    )
    changed = record.model_copy(
        update={
            "statistics": statistics,
            "files": dict(sorted({**record.files, **hashes}.items())),
        }
    )
    files.write_text(tree.record_path(name), changed.model_dump_json(indent=1) + "\n")


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
    return {each.name for each in record.statistics.exposures}
