"""`megalopta dataset check`: a dataset of many sequences against its records and its plan.

Every file against its hash, shapes against the configuration, the records against the manifest, the
index against the Croissant file, and of a few sequences the truth derived another way.
"""

import json
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path

import pyarrow.parquet as pq
from rich.console import Console

from megalopta.config.drawing import sequence_name
from megalopta.core import files
from megalopta.core.bounded import printable
from megalopta.core.errors import UserError
from megalopta.core.folders import LOCK_NAME
from megalopta.core.progress import progress, silent
from megalopta.dataset.croissant import table_path
from megalopta.dataset.finished import FinishedSequence, difference
from megalopta.dataset.layout import BOOKS, Tree
from megalopta.dataset.manifest import is_as_written, is_in_manifest, read_manifest
from megalopta.dataset.record import SequenceRecord
from megalopta.dataset.splits import read_lists
from megalopta.dataset.store import Dataset, files_in, whole_of
from megalopta.dataset.tables import TABLES
from megalopta.generation.sequence import recorded_machinery
from megalopta.generation.staging import MADE, staged_sequences
from megalopta.stages.origins import provenance_changes
from megalopta.verification.integrity import Fault, wrong_shape
from megalopta.verification.truth import check_truth

_OWN = (
    *("dataset.yaml", "manifest.jsonl", "croissant.json", "README.md", "index.html"),
    *("failed.jsonl", LOCK_NAME),
)


def run_check_tree(root: Path, truths: int, console: Console | None = None) -> bool:
    """Check a dataset, with the truth of so many sequences; print what is wrong, return if nothing.

    Raises UserError where there is no dataset of many sequences.
    """
    console, tree = console or Console(), Tree(root)
    faults = check_tree(tree, truths)
    for fault in faults:
        console.print(
            printable(f"{fault.path}: {fault.what}; {fault.remedy}"),
            markup=False, highlight=False, soft_wrap=True,
        )  # fmt: skip
    names = tree.names()
    console.print(
        f"{len(names)} of {tree.plan().sequences} sequences, truth of {min(truths, len(names))} "
        f"derived again: {len(faults) or 'no'} faults"
    )
    return not faults


def check_tree(tree: Tree, truths: int = 0) -> list[Fault]:
    """Everything that is not as it was written, or is missing."""
    plan, names = tree.plan(), tree.names()
    faults = list(_unmade(tree, plan.sequences, names))
    faults += _manifest_faults(tree, names)
    faults += _table_faults(tree, len(names))
    faults += _list_faults(tree, names)
    known: set[Path] = set()
    machinery: dict[str, str] = {}
    chosen = set(names[:: max(1, len(names) // truths)][:truths]) if truths else set()
    with progress("Checking sequences", len(names), "sequence") as advance:
        for name in names:
            try:
                record = tree.record(name)
                known.update(tree.root / path for path in record.files)
                machinery[name] = _machinery(record)
                faults += _sequence_faults(tree, record, tree.dataset(record), name in chosen)
            except UserError as problem:
                faults.append(Fault(tree.record_path(name), "is damaged", str(problem)))
            advance()
    return [*faults, *_mixture(tree, machinery), *_unfinished(tree), *_unknown(tree, known)]


def _unmade(tree: Tree, sequences: int, names: list[str]) -> Iterator[Fault]:
    missing = sequences - len(names)
    if missing > 0:
        there = set(names)
        first = next(n for n in map(sequence_name, range(sequences)) if n not in there)
        yield Fault(
            tree.record_path(first),
            f"{missing} sequences of the plan are not made, this is the first",
            _again(tree),
        )


def _again(tree: Tree) -> str:
    return f"run: megalopta dataset make {tree.root} --out {tree.root}"


def _manifest_faults(tree: Tree, names: list[str]) -> Iterator[Fault]:
    path = tree.root / "manifest.jsonl"
    try:
        hashes = read_manifest(tree.root)
    except UserError as problem:
        yield Fault(path, "is damaged", str(problem))
        return
    if sorted(hashes) != names:
        yield Fault(path, f"lists {len(hashes)} sequences, there are {len(names)}", _again(tree))
    for record in map(tree.record_path, set(names) & hashes.keys()):
        if what := _record_fault(record, hashes):
            remedy = _again(tree) if "exposed" in what else f"remove it and {_again(tree)}"
            yield Fault(record, what, remedy)


def _record_fault(record: Path, hashes: Mapping[str, str]) -> str | None:
    try:
        if is_in_manifest(record, hashes):
            return None
        if is_as_written(record, hashes):
            return "was exposed since the index was written"
    except UserError:  # which is told where the record is read
        return None
    return "is not as it was written"


def _table_faults(tree: Tree, sequences: int) -> Iterator[Fault]:
    for name in TABLES:
        try:
            table = table_path(tree.root, name)
            rows = pq.read_metadata(table).num_rows
        except (UserError, OSError, ValueError) as problem:
            path = tree.root / "index" / f"{name}.parquet"
            yield Fault(path, f"cannot be relied on ({problem})", _again(tree))
            continue
        if name == "sequences" and rows != sequences:
            yield Fault(table, f"has {rows} rows for {sequences} sequences", _again(tree))


def _list_faults(tree: Tree, names: list[str]) -> Iterator[Fault]:
    try:
        read_lists(tree.root, names)
    except UserError as problem:
        yield Fault(tree.root / "splits", "cannot be relied on", str(problem))


def _sequence_faults(
    tree: Tree, record: SequenceRecord, dataset: FinishedSequence, with_truth: bool
) -> list[Fault]:
    faults = _file_faults(tree, record, dataset)
    return faults if faults or not with_truth else list(_truth_faults(tree, dataset))


def _machinery(record: SequenceRecord) -> str:
    """With what a sequence was made, and the backend that was asked for: of these it may differ."""
    made = {stage: recorded_machinery(record, stage) for stage in MADE}
    backend = record.configuration.get("render", {}).get("backend")
    return json.dumps({"made": made, "backend": backend}, sort_keys=True)


def _mixture(tree: Tree, machinery: Mapping[str, str]) -> Iterator[Fault]:
    """Sequences that were made otherwise than most: their bytes are not those of one program."""
    by_backend: dict[str, Counter[str]] = {}
    for each in machinery.values():
        by_backend.setdefault(json.loads(each)["backend"], Counter())[each] += 1
    most = {name: json.loads(all_.most_common(1)[0][0]) for name, all_ in by_backend.items()}
    for name, each in machinery.items():
        own = json.loads(each)
        usual = most[own["backend"]]["made"]
        told = {s: provenance_changes(usual[s], own["made"][s]) for s in MADE}
        if any(told.values()):
            what = "; ".join(f"{stage}: {change}" for stage, change in told.items() if change)
            yield Fault(
                tree.record_path(name),
                f"was made otherwise than most sequences ({what})",
                f"remove it and with the program that made the others {_again(tree)}",
            )


def _file_faults(tree: Tree, record: SequenceRecord, dataset: FinishedSequence) -> list[Fault]:
    faults: dict[Path, Fault] = {}
    remedy = f"remove {tree.record_path(record.sequence)} and {_again(tree)}"
    for name, (size, hashed) in record.files.items():
        path = tree.root / name
        if what := difference(path, size, hashed) or _wrong_shape(dataset, path):
            faults[whole_of(path, tree.root)] = Fault(path, what, remedy)
    return list(faults.values())


def _wrong_shape(dataset: Dataset, path: Path) -> str | None:
    try:
        return wrong_shape(dataset, path)
    except Exception as problem:  # of a file that somebody made up, anything
        return f"cannot be read ({type(problem).__name__})"


def _truth_faults(tree: Tree, dataset: FinishedSequence) -> Iterator[Fault]:
    place = tree.root / "truth" / dataset.sequence
    try:
        with silent():
            residuals = check_truth(dataset)
    except (UserError, ValueError) as problem:
        yield Fault(place, f"cannot be derived again ({problem})", "make the sequence again")
        return
    for each in residuals:
        if not each.passed:
            yield Fault(
                place,
                f"flow of {each.name} differs by {each.median:.2g} px from another derivation",
                "the program has a fault there, tell its authors",
            )


def _unfinished(tree: Tree) -> Iterator[Fault]:
    staged = [folder for folder, _ in staged_sequences(tree)]
    if staged:
        yield Fault(tree.staging, "holds sequences that are not finished", _again(tree))
    for path in sorted(set(tree.staging.glob("*")) - set(staged)):
        yield Fault(path, "belongs to no sequence of this dataset", "move it elsewhere")
    if tree.failures.exists():
        remedy = f"{_again(tree)} --retry"
        yield Fault(tree.failures, "lists sequences that could not be made", remedy)


def _unknown(tree: Tree, known: set[Path]) -> Iterator[Fault]:
    own = {tree.root / name for name in _OWN}
    folders = {*BOOKS, tree.staging.name}
    for top in tree.root.iterdir():
        if top.name in folders or files.is_temporary(top):
            continue
        for path in sorted(set(files_in([top])) - known - own):
            yield Fault(path, "belongs to no sequence of this dataset", "move it elsewhere")
