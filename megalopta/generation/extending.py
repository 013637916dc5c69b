"""More output for sequences that are made: new exposures, or what a stage measures.

It is made beside the tree, as sequences are, from links to what is there; a sequence's record names
it when all of it is there.
"""

from collections.abc import Callable, Collection, Iterable
from contextlib import closing
from functools import partial

from megalopta.config.drawing import sequence_name
from megalopta.config.model import Configuration
from megalopta.core.errors import UserError
from megalopta.core.folders import locked
from megalopta.core.format_numbers import written
from megalopta.core.progress import progress, silent
from megalopta.dataset.books import write_index
from megalopta.dataset.layout import Tree
from megalopta.dataset.record import SequenceRecord
from megalopta.dataset.store import Dataset, file_hash
from megalopta.generation.attempt import Job
from megalopta.generation.jobs import run_jobs
from megalopta.generation.staging import ADDED, begin, clear, finish, publish, settle, tidy

Work = Callable[[Dataset], SequenceRecord]
"""Adds output to a dataset of links, and returns the record with it."""


def extend(
    tree: Tree,
    title: str,
    check: Callable[[SequenceRecord], None],
    job: Job,
    workers: int | None = None,
    scheduler: str | None = None,
) -> Tree:
    """Do a job for every finished sequence, after checking all, and write the index anew.

    Raises
    ------
    UserError
        When there is no dataset of many sequences, and when a check or a job fails.
    """
    index = partial(write_index, tree, tree.plan())
    with locked(tree.root):
        tidy(tree, keep_added=True)
        settle(tree, index)
        indices = [_checked(tree.record(name), check) for name in tree.names()]
        problems = _problems(job, indices, title, workers, scheduler)
        index()
        tidy(tree, keep_added=bool(problems))
    if problems:
        raise UserError(problems[0])
    return tree


def extend_sequence(
    tree: Tree,
    record: SequenceRecord,
    stage: str,
    settings: Configuration,
    kinds: Iterable[str],
    work: Work,
) -> None:
    """Add to one sequence what some work makes for a stage of its output of some kinds."""
    name = record.sequence
    staged = tree.staging / f"{name}{ADDED}"
    with locked(staged), silent():
        dataset = Dataset(begin(staged, settings, [stage]), settings)
        _link(tree, record, dataset, kinds)
        changes = {
            "format": written("sequence"),
            "replaced": file_hash(tree.record_path(name)),
        }
        finish(tree, staged, work(dataset).model_copy(update=changes))
        publish(tree, staged, name)
        clear(staged)


def _checked(record: SequenceRecord, check: Callable[[SequenceRecord], None]) -> int:
    check(record)
    return record.index


def _problems(
    job: Job, indices: Collection[int], title: str, workers: int | None, scheduler: str | None
) -> list[str]:
    """The first problem that there is; after it nothing is begun."""
    with (
        progress(title, len(indices), "sequence") as advance,
        closing(run_jobs(job, indices, workers, scheduler)) as outcomes,
    ):
        for outcome in outcomes:
            if outcome.problem:
                return [f"sequence {sequence_name(outcome.index)}: {outcome.problem}"]
            advance()
    return []


def _link(tree: Tree, record: SequenceRecord, dataset: Dataset, kinds: Iterable[str]) -> None:
    """Link what is there to where it is read, after comparing it with the record."""
    whole, name = tree.dataset(record), record.sequence
    for kind in kinds:
        folder = f"{kind}/{name}"
        whole.compare_all(f"{folder}/")
        link = dataset.root / folder
        if (tree.root / folder).is_dir() and not link.is_symlink():
            link.parent.mkdir(parents=True, exist_ok=True)
            above = "../" * len(link.parent.relative_to(tree.root).parts)
            # relative, so that a dataset may be moved meanwhile
            link.symlink_to(f"{above}{folder}", target_is_directory=True)
