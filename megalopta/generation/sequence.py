"""One sequence of a plan, made beside the tree and moved into it when it is whole.

It is an ordinary dataset in `.making/SEQ/data` until then, so that a run that was killed goes on
inside the sequence.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from megalopta.config.drawing import configuration_of, sequence_name, split_of
from megalopta.config.model import Configuration
from megalopta.config.recipe import Plan
from megalopta.core.errors import UserError
from megalopta.core.folders import locked
from megalopta.core.format_numbers import written
from megalopta.core.progress import silent
from megalopta.dataset.layout import Tree
from megalopta.dataset.record import MADE, SequenceRecord
from megalopta.dataset.store import hashes_of
from megalopta.generation.flow_files import write_flow_files
from megalopta.generation.staging import (
    begin,
    clear,
    finish,
    is_finished,
    made_with,
    publish,
)
from megalopta.generation.statistics import sequence_statistics
from megalopta.stages.ledger import Ledger
from megalopta.stages.origins import provenance_changes
from megalopta.stages.pipeline import run_stage


class Machinery(NamedTuple):
    """With what one sequence of a plan would be made, in the process that asks for all of them."""

    sequence: int
    made_with: Mapping[str, Mapping[str, str]]

    @classmethod
    def here(cls, plan: Plan, index: int) -> "Machinery":
        """Return that of this process."""
        return cls(index, made_with(configuration_of(plan, index)))


def make_sequence(root: Path, plan: Plan, wanted: Machinery, index: int) -> None:
    """Make a sequence, or what is missing of it. Raises UserError and OSError."""
    tree, name = Tree(root), sequence_name(index)
    staged = tree.staging / name
    _check_machinery(plan, wanted)
    with locked(staged), silent():
        if not tree.record_path(name).exists():
            configuration = configuration_of(plan, index)
            data = begin(staged, configuration)
            if not is_finished(staged):
                finish(tree, staged, _made(data, configuration, plan, index))
            publish(tree, staged, name)
        clear(staged)


def other_machinery(record: SequenceRecord, configuration: Configuration, *stages: str) -> str:
    """Return how stages of a finished sequence were made otherwise than here, or nothing."""
    here = made_with(configuration)
    found = {
        stage: provenance_changes(record.stages[stage].made_with, here[stage])
        for stage in stages or MADE
    }
    return "; ".join(f"{stage}: {told}" for stage, told in found.items() if told)


def _check_machinery(plan: Plan, wanted: Machinery) -> None:
    """Refuse to make, in another process, what is not the same bytes."""
    here = Machinery.here(plan, wanted.sequence)
    for stage in MADE:
        if told := provenance_changes(wanted.made_with[stage], here.made_with[stage]):
            raise UserError(
                f"this worker would make other bytes ({stage}: {told}); give all workers the same "
                "libraries and variant"
            )


def _made(data: Path, configuration: Configuration, plan: Plan, index: int) -> SequenceRecord:
    for stage in MADE:
        dataset = run_stage(data, configuration, stage)
    stages = Ledger(dataset).record().stages
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
