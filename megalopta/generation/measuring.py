"""What a stage measures on every sequence of a dataset of many, such as flow."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path

from megalopta import __version__
from megalopta.config.drawing import sequence_name
from megalopta.config.model import Configuration, differences, parse
from megalopta.config.yaml_model import to_yaml
from megalopta.core.errors import UserError
from megalopta.dataset.layout import Tree
from megalopta.dataset.record import KINDS, SequenceRecord, StageRecord
from megalopta.dataset.store import Dataset, hashes_of
from megalopta.generation.extending import extend, extend_sequence
from megalopta.stages.ledger import Ledger, stage_configuration, stage_hash
from megalopta.stages.origins import provenance
from megalopta.stages.pipeline import check_stage
from megalopta.stages.registry import STAGES


def measure(
    root: Path,
    stage: str,
    overrides: Mapping[str, str],
    redo: bool = False,
    workers: int | None = None,
    scheduler: str | None = None,
) -> Tree:
    """Run a stage on every finished sequence on which it is not finished.

    Raises
    ------
    UserError
        When a setting concerns an earlier stage, or the stage was run with others and is not to be
        run again.
    """
    tree = Tree(root.absolute())
    check = partial(_check, tree, stage, overrides, redo)
    job = partial(measure_sequence, tree.root, stage, overrides, redo)
    return extend(tree, f"Measuring sequences ({stage})", check, job, workers, scheduler)


def measure_sequence(
    root: Path, stage: str, overrides: Mapping[str, str], redo: bool, index: int
) -> None:
    """Run a stage on one sequence, unless it is finished with these settings."""
    tree = Tree(root)
    record = tree.record(sequence_name(index))
    settings = _settings(tree, record, overrides)
    there = record.stages.get(stage)
    is_same = there is not None and there.settings == stage_hash(settings, stage)
    if redo or not is_same or Ledger(tree.dataset(record)).damaged(stage, record.stages[stage]):
        kinds = [kind for kind in KINDS if kind != "results"]
        extend_sequence(tree, record, stage, settings, kinds, partial(_measured, record, stage))


def _settings(tree: Tree, record: SequenceRecord, overrides: Mapping[str, str]) -> Configuration:
    stored = to_yaml(tree.dataset(record).configuration)
    return parse(stored, str(tree.record_path(record.sequence)), overrides)


def _check(
    tree: Tree, stage: str, overrides: Mapping[str, str], redo: bool, record: SequenceRecord
) -> None:
    settings = _settings(tree, record, overrides)
    made = tree.dataset(record).configuration
    for earlier in STAGES[stage].needs:
        before, now = (stage_configuration(each, earlier) for each in (made, settings))
        if changes := differences(before, now):
            raise UserError(
                f"{tree.root}: {changes[0]} would change what {earlier!r} made; {stage} takes "
                f"settings of its own: {', '.join(STAGES[stage].fields)}"
            )
    there = record.stages.get(stage)
    if there and there.settings != stage_hash(settings, stage) and not redo:
        raise UserError(
            f"{tree.root}: sequence {record.sequence} holds {stage} output of other settings; add "
            "--redo to replace it"
        )
    check_stage(stage, settings, tree.root)


def _measured(record: SequenceRecord, stage: str, dataset: Dataset) -> SequenceRecord:
    declared, settings = STAGES[stage], dataset.configuration
    declared.work(dataset)
    entry = StageRecord(
        settings=stage_hash(settings, stage),
        made_with=provenance(stage, settings),
        version=__version__,
        files=hashes_of(dataset.root, declared.outputs(dataset)),
    )
    return record.model_copy(update={"stages": {**record.stages, stage: entry}})
