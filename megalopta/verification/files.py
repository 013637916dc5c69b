"""`megalopta check files`: a dataset against its records and its plan.

Hashes and unknown files; of a plan, its sequences, index and splits, and the truth of a few.
"""

import shlex
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import pyarrow.parquet as pq
from rich.console import Console

from megalopta.config.drawing import sequence_name
from megalopta.config.recipe import Plan
from megalopta.core import files
from megalopta.core.bounded import printable, read_json
from megalopta.core.errors import UserError, shell_command
from megalopta.core.folders import LOCK_NAME
from megalopta.core.progress import progress, silent
from megalopta.dataset import index
from megalopta.dataset.store import BOOKS, Dataset, Tree, file_difference, whole_of
from megalopta.stages.registry import STAGES
from megalopta.stages.run import entry

_OWN = ("dataset.yaml", "report.html", "croissant.json", "README.md", "index.html", LOCK_NAME)


class FileFault(NamedTuple):
    """A damaged, missing or unknown file."""

    path: Path
    fault: str
    remedy: str


Faults = Iterator[FileFault]


def run_check_files(root: Path, truths: int = 0) -> bool:
    """Check a dataset, with the truth of `truths` sequences; print faults, return True if none.

    Raises UserError if there is no dataset.
    """
    console, tree = Console(), Tree(root)
    faults = check_files(tree, truths)
    for fault in faults:
        console.print(
            printable(f"{fault.path}: {fault.fault}; {fault.remedy}"),
            markup=False, highlight=False, soft_wrap=True,
        )  # fmt: skip
    names, checked = tree.names(), ""
    if plan := tree.plan:
        checked = f" of {plan.sequences}, truth of {min(truths, len(names))} rederived"
    console.print(f"sequences: {len(names)}{checked}; {len(faults) or 'no'} faults")
    return not faults


def check_files(tree: Tree, truths: int = 0) -> list[FileFault]:
    """Return everything that is modified, missing, or unknown."""
    plan, names, known = tree.plan, tree.names(), set[Path]()
    chosen = names[:: max(1, len(names) // truths)][:truths] if plan and truths else []
    all_faults: list[FileFault] = []
    with progress("Checking sequences", len(names), "sequence") as advance:
        for name in names:
            try:
                dataset = tree.opened(name)
            except UserError as problem:
                all_faults.append(FileFault(tree.record_path(name), "is damaged", str(problem)))
            else:
                known |= {tree.root / path for path in dataset.former.files}
                known.add(dataset.result("timings.json"))
                faults = list(_file_faults(dataset, plan))
                all_faults += faults if faults or name not in chosen else _truth_faults(dataset)
            advance()
    if plan:
        all_faults += _plan_faults(tree, plan, names)
    all_faults += [
        FileFault(path, "is of a sequence that is not finished", f"run: {tree.make_again}")
        for path in sorted((tree.root / "sequences").glob("*.begun"))
    ]
    known |= {tree.root / name for name in _OWN}
    for top in tree.root.iterdir():
        if top.name not in (*BOOKS, "ranking") and not files.is_temporary(top):  # the demo ranks
            for path in sorted(set(files.files_in([top])) - known):
                fault = "belongs to no sequence of this dataset"
                all_faults.append(FileFault(path, fault, "move it elsewhere"))
    return all_faults


def _file_faults(dataset: Dataset, plan: Plan | None) -> Faults:
    """Yield modified files of finished stages, each store once."""
    root, faults = dataset.root, dict[Path, FileFault]()
    for stage in STAGES:
        finished = entry(dataset, stage)
        for name, (size, digest) in (finished.files or {} if finished else {}).items():
            path = root / name
            if fault := file_difference(path, size, digest):
                store = whole_of(path, root)
                damaged, verb = store if store.exists() else None, STAGES[stage].command
                if plan:
                    damaged, verb = dataset.record_path, "dataset make"
                out = ("--out", root) if plan or stage == "render" else ()
                remove = f"remove {shlex.quote(str(damaged))} and " if damaged else ""
                again = f"{remove}run: {shell_command(*verb.split(), root, *out)}"
                faults[store] = FileFault(path, fault, again)
    yield from faults.values()


def _plan_faults(tree: Tree, plan: Plan, names: list[str]) -> Faults:
    """Yield missing sequences, and faults of tables, of their description, and of splits."""
    root, again = tree.root, f"run: {tree.make_again}"
    if (missing := plan.sequences - len(names)) > 0:
        first = next(n for n in map(sequence_name, range(plan.sequences)) if n not in names)
        fault = f"{missing} sequences of the plan are missing, this is the first"
        yield FileFault(tree.record_path(first), fault, again)
    for table in index.TABLES:
        path = root / "index" / f"{table}.parquet"
        try:
            rows = pq.read_metadata(index.table_path(root, table)).num_rows
        except (UserError, OSError, ValueError) as problem:
            yield FileFault(path, f"is unreliable ({problem})", again)
            continue
        if table == "sequences" and rows != len(names):
            yield FileFault(path, f"has {rows} rows for {len(names)} sequences", again)
    described = root / "croissant.json"
    with suppress(UserError, OSError, ValueError, KeyError):  # of tables that are reported above
        description = read_json(described)
        if description != index.croissant(root, plan, str(description["version"])):
            yield FileFault(described, "differs from the plan and the tables", again)
    try:
        lists = index.read_lists(root, names)
    except UserError as problem:
        yield FileFault(root / "splits", "are unreliable", str(problem))
        return
    members_of: dict[str, list[str]] = {split: [] for split in (*plan.splits, *lists)}
    for name in names:
        with suppress(UserError):  # of a record that is reported above
            record = tree.record(name)
            for split in index.splits_of(record, plan):
                members_of.setdefault(split, []).append(name)
                links = index.split_links(root, split, record)
                if missing_link := next((link for link in links if not link.exists()), None):
                    yield FileFault(missing_link, "is missing", again)
    for split, members in members_of.items():
        if list(lists.get(split, [])) != members:
            path = root / "splits" / f"{split}.txt"
            yield FileFault(path, "is missing or differs from the records", again)


def _truth_faults(dataset: Dataset) -> Faults:
    from megalopta.verification.truth import check_truth  # needs the renderer

    path = dataset.root / "truth" / dataset.sequence
    try:
        with silent():
            residuals = check_truth(dataset)
    except (UserError, ValueError) as problem:
        yield FileFault(path, f"cannot be rederived ({problem})", "regenerate the sequence")
        return
    for residual in residuals:
        if not residual.passed:
            fault = f"flow of {residual.name} differs by {residual.median:.2g} px"
            remedy = "this is a bug of megalopta; report it"
            yield FileFault(path, f"{fault} from a second derivation", remedy)
