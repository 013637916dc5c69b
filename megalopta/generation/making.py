"""A plan brought to its end: what is missing is made, what is there is kept."""

import re
from collections.abc import Iterable, Iterator
from contextlib import closing
from functools import partial
from pathlib import Path

from megalopta.config.drawing import check_plan, configuration_of, sequence_name
from megalopta.config.model import differences
from megalopta.config.recipe import Plan
from megalopta.core import files
from megalopta.core.errors import UserError
from megalopta.core.folders import LOCK_NAME, locked
from megalopta.core.progress import progress, say
from megalopta.dataset.books import write_index
from megalopta.dataset.layout import Tree
from megalopta.dataset.record import MADE, SequenceRecord
from megalopta.generation.jobs import run_jobs
from megalopta.generation.sequence import Machinery, make_sequence, other_machinery
from megalopta.generation.staging import settle, tidy
from megalopta.stages.pipeline import check_stage

_COMPARED = 50
"""Sequences that are there of which the configuration is compared with the plan's."""


def make(
    root: Path,
    plan: Plan,
    *,
    only: Iterable[int] | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    retry: bool = False,
) -> Tree:
    """Make the sequences of a plan that are not there yet.

    Parameters
    ----------
    root : Path
    plan : Plan
    only : iterable of int or None
        Sequences to make; by default all of the plan.
    workers : int or None
        Processes of this machine; None makes all in this one.
    scheduler : str or None
        Address of a Dask cluster to use instead.
    retry : bool
        Make only those that failed before.

    Raises
    ------
    UserError
        When the folder holds something else or sequences of another plan, when the machine refuses,
        such as a full disk, and after all others are made where sequences failed.
    """
    tree = Tree(root.absolute())
    for configuration in check_plan(plan):
        for stage in MADE:
            check_stage(stage, configuration, tree.staging)
    whole = whole_plan(tree, plan)
    index = partial(write_index, tree, whole)
    with locked(tree.root):
        tidy(tree)
        settle(tree, index)
        tree.write_plan(whole)
        failures = tree.read_failures()
        again = [index for index in sorted(failures) if index in range(whole.sequences)]
        wanted = again if retry else list(only) if only is not None else None
        todo = _missing(tree, range(plan.sequences) if wanted is None else wanted)
        try:
            _make_all(tree, plan, todo, failures, workers, scheduler)
        finally:
            tree.write_failures(failures)
        index()
        tidy(tree)
    if failures:
        first = min(failures)
        raise UserError(
            f"{len(failures)} sequences failed, such as {sequence_name(first)}: {failures[first]}; "
            f"all are listed in {tree.failures}; --retry makes them again"
        )
    return tree


def parse_indices(text: str, sequences: int) -> list[int]:
    """Read numbers of sequences, such as "731" or "0-9,20". Raises UserError."""
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
    job = partial(make_sequence, tree.root, plan, Machinery.here(plan, todo[0]))
    with (
        progress("Making sequences", len(todo), "sequence") as advance,
        closing(run_jobs(job, todo, workers, scheduler)) as outcomes,
    ):
        for outcome in outcomes:
            if outcome.ends_all:
                raise UserError(f"sequence {sequence_name(outcome.index)}: {outcome.problem}")
            failures.pop(outcome.index, None)
            if outcome.problem:
                failures[outcome.index] = outcome.problem
                say(f"sequence {sequence_name(outcome.index)} failed: {outcome.problem}")
                tree.write_failures(failures)
            advance()


def _missing(tree: Tree, indices: Iterable[int]) -> list[int]:
    there = set(tree.names())
    return [index for index in indices if sequence_name(index) not in there]


def whole_plan(tree: Tree, plan: Plan) -> Plan:
    """The plan of a folder: this one, with as many sequences as were ever asked for.

    Raises
    ------
    UserError
        For a folder of something else, and one whose sequences another plan made.
    """
    root = tree.root
    if not (root / "dataset.yaml").exists():
        if root.exists() and (not root.is_dir() or any(map(_is_a_strangers, root.iterdir()))):
            raise UserError(f"{root} exists and is no dataset; choose a new folder")
        return plan
    former = tree.plan()
    old, new = (each.model_dump(mode="json") for each in (former, plan))
    if changes := differences({**old, "sequences": 0}, {**new, "sequences": 0}):
        raise UserError(
            f"{root} was made from another plan ({'; '.join(changes[:3])}); choose another folder "
            "(more sequences may be asked for)"
        )
    for record in _some_records(tree):
        drawn = configuration_of(plan, record.index).model_dump(mode="json")
        if changes := differences(record.configuration, drawn):
            raise UserError(
                f"{root}: the plan, or another version of the program, would make sequence "
                f"{record.sequence} otherwise now ({'; '.join(changes[:3])}); choose another folder"
            )
    return plan.model_copy(update={"sequences": max(former.sequences, plan.sequences)})


def _is_a_strangers(path: Path) -> bool:
    return path.name != LOCK_NAME and not files.is_temporary(Path(path.name))


def _check_same_machinery(tree: Tree) -> None:
    """Refuse to add sequences of other models, libraries or variants to those that are there."""
    for record in _some_records(tree):
        if changes := other_machinery(record, tree.dataset(record).configuration):
            raise UserError(
                f"{tree.root}: sequence {record.sequence} was made otherwise than more would be "
                f"here ({changes}); go on with what made it, choose another folder, or remove "
                f"{tree.records} to make all again"
            )


def _some_records(tree: Tree) -> Iterator[SequenceRecord]:
    names = tree.names()
    return map(tree.record, names[:: max(1, len(names) // _COMPARED)])
