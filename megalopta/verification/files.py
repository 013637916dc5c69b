"""`megalopta check files`: a dataset against its records and its plan.

Every file is compared with its hash, shapes with the configuration, and unknown files are reported.
For many sequences, also the records with the manifest, the index with the Croissant file, and the
truth of a few sequences with a second derivation.
"""

import json
import shlex
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import NamedTuple

import pyarrow.parquet as pq
from rich.console import Console

from megalopta.benchmark.ranking_run import FOLDER
from megalopta.config.drawing import sequence_name
from megalopta.core import files
from megalopta.core.bounded import METADATA, open_store, printable, read_json
from megalopta.core.errors import UserError, shell_command
from megalopta.core.folders import LOCK_NAME
from megalopta.core.progress import progress, silent
from megalopta.dataset.index import (
    TABLES,
    croissant,
    read_lists,
    split_links,
    splits_of,
    table_path,
)
from megalopta.dataset.layout import BOOKS, MANIFEST, Tree
from megalopta.dataset.record import MADE, SequenceRecord, StageRecord
from megalopta.dataset.store import Dataset, file_difference, files_in, whole_of
from megalopta.generation.staging import staged_sequences
from megalopta.render import read_size
from megalopta.stages.ledger import Ledger
from megalopta.stages.registry import STAGES, provenance_changes
from megalopta.verification.truth import check_truth

_OWN = (
    *("dataset.yaml", "manifest.jsonl", "timings.json", "report.html", "croissant.json"),
    *("README.md", "index.html", "failed.jsonl", LOCK_NAME),
)
_STRANGE = "belongs to no sequence of this dataset"


class FileFault(NamedTuple):
    """A damaged, missing or unknown file."""

    path: Path
    what: str
    remedy: str
    """Remedy."""


Faults = Iterator[FileFault]


def run_check_files(root: Path, truths: int = 0) -> bool:
    """Check a dataset, with the truth of `truths` sequences; print faults, return True if none.

    Raises UserError if there is no dataset.
    """
    console, tree = Console(), Tree(root)
    faults = check_files(tree, truths)
    for fault in faults:
        console.print(
            printable(f"{fault.path}: {fault.what}; {fault.remedy}"),
            markup=False, highlight=False, soft_wrap=True,
        )  # fmt: skip
    console.print(f"{_checked(tree, truths)}: {len(faults) or 'no'} faults")
    return not faults


def check_files(tree: Tree, truths: int = 0) -> list[FileFault]:
    """Return everything that is modified, missing, or unknown."""
    return list(_lone_faults(tree.lone) if tree.lone else _faults_of_many(tree, truths))


def _checked(tree: Tree, truths: int) -> str:
    """Return a summary of the checks."""
    if tree.lone:
        ledger = Ledger(tree.lone)
        entries = {stage: entry for stage in STAGES if (entry := ledger.entry(stage))}
        total = sum(len(entry.files or {}) for entry in entries.values())
        return f"{total} files of {', '.join(entries) or 'no finished stage'}"
    made = len(tree.names())
    return f"{made} of {tree.plan().sequences} sequences, truth of {min(truths, made)} rederived"


def wrong_shape(dataset: Dataset, path: Path) -> str | None:
    """Return what is wrong with the shape of a file, or with the store that it describes."""
    camera = dataset.configuration.camera
    size = (camera.height, camera.width)
    try:
        if path.suffix == ".exr" and (found := read_size(path)) != size:
            return f"has {found[1]} × {found[0]} px instead of {size[1]} × {size[0]}"
        whole = whole_of(path, dataset.root)
        if path.name.startswith(".z") or (path.name == METADATA and path.parent == whole):
            counts = open_store(whole).arrays.get("counts")
            wanted = (dataset.configuration.trajectory.frames, *size)
            if counts is not None and counts.shape != wanted:
                return f"has counts of shape {tuple(counts.shape)} instead of {wanted}"
    except Exception as problem:  # a forged file can raise any exception
        return f"cannot be read ({problem or type(problem).__name__})"
    return None


def _lone_faults(dataset: Dataset) -> Faults:
    """Yield faults of one sequence. Unfinished output has no hashes yet and is not checked."""
    ledger, root = Ledger(dataset), dataset.root
    known = set(files_in([dataset.record_path, root / FOLDER]))
    for stage in STAGES:
        if entry := ledger.entry(stage):
            with progress(f"Checking files of {stage}", len(entry.files or {}), "file") as advance:
                yield from _file_faults(dataset, entry, partial(_mend, root, stage), advance)
            known.update(root / name for name in entry.files or {})
        else:
            known.update(files_in(ledger.outputs(stage)))
    yield from _unknown(root, known)


def _mend(root: Path, stage: str, whole: Path) -> str:
    out = ("--out", root) if stage == "render" else ()
    remove = f"remove {shlex.quote(str(whole))} and " if whole.exists() else ""
    return f"{remove}run: {shell_command(*STAGES[stage].command.split(), root, *out)}"


def _file_faults(
    dataset: Dataset,
    entry: StageRecord,
    remedy: Callable[[Path], str],
    advance: Callable[[], None] = lambda: None,
) -> Faults:
    """Yield modified files of a stage, each store once."""
    faults: dict[Path, FileFault] = {}
    for name, (size, hashed) in (entry.files or {}).items():
        path = dataset.root / name
        if what := file_difference(path, size, hashed) or wrong_shape(dataset, path):
            whole = whole_of(path, dataset.root)
            faults[whole] = FileFault(path, what, remedy(whole))
        advance()
    yield from faults.values()


def _unknown(root: Path, known: set[Path], *folders: str) -> Faults:
    """Yield files that no sequence wrote, except in the dataset's own folders."""
    known = known | {root / name for name in _OWN}
    for top in root.iterdir():
        if top.name not in folders and not files.is_temporary(top):
            for path in sorted(set(files_in([top])) - known):
                yield FileFault(path, _STRANGE, "move it elsewhere")


def _faults_of_many(tree: Tree, truths: int) -> Faults:
    names, again = tree.names(), f"run: {tree.make_again}"
    yield from _unmade(tree, names, again)
    yield from _manifest_faults(tree, names, again)
    yield from _index_faults(tree, names, again)
    plan, known = tree.plan(), set[Path]()
    machinery: dict[str, str] = {}
    splits: dict[str, list[str]] = {split: [] for split in plan.splits}
    splits |= {"sample": []} if plan.sample else {}
    chosen = set(names[:: max(1, len(names) // truths)][:truths]) if truths else set()
    with progress("Checking sequences", len(names), "sequence") as advance:
        for name in names:
            try:
                record = tree.record(name)
                known.update(tree.root / path for path in record.files)
                machinery[name] = _machinery(record)
                for split in splits_of(record, plan):
                    splits.setdefault(split, []).append(name)
                    links = split_links(tree.root, split, record)
                    if lost := next((link for link in links if not link.is_symlink()), None):
                        yield FileFault(lost, "is missing", again)
                yield from _sequence_faults(tree.dataset(record), name in chosen, again)
            except UserError as problem:
                yield FileFault(tree.record_path(name), "is damaged", str(problem))
            advance()
    yield from _mixture(tree, machinery, again)
    yield from _list_faults(tree, names, splits, again)
    yield from _unfinished(tree, again)
    yield from _unknown(tree.root, known, *BOOKS, tree.staging.name)


def _unmade(tree: Tree, names: list[str], again: str) -> Faults:
    wanted = tree.plan().sequences
    if (missing := wanted - len(names)) > 0:
        there = set(names)
        first = next(n for n in map(sequence_name, range(wanted)) if n not in there)
        what = f"{missing} sequences of the plan are missing, this is the first"
        yield FileFault(tree.record_path(first), what, again)


def _manifest_faults(tree: Tree, names: list[str], again: str) -> Faults:
    path = tree.root / MANIFEST
    try:
        hashes = tree.read_manifest()
    except UserError as problem:
        yield FileFault(path, "is damaged", str(problem))
        return
    if sorted(hashes) != names:
        yield FileFault(path, f"lists {len(hashes)} sequences, but there are {len(names)}", again)
    for name in set(names) & hashes.keys():
        record = tree.record_path(name)
        with suppress(UserError):  # reported where the record is read
            if not tree.is_as_written(name, hashes):
                yield FileFault(record, "differs from the manifest", f"remove it and {again}")
            elif not tree.is_known(name, hashes):
                yield FileFault(record, "has more output than the index knows", again)


def _index_faults(tree: Tree, names: list[str], again: str) -> Faults:
    """Yield faults of the tables and of their description."""
    for name in TABLES:
        try:
            table = table_path(tree.root, name)
            rows = pq.read_metadata(table).num_rows
        except (UserError, OSError, ValueError) as problem:
            path = tree.root / "index" / f"{name}.parquet"
            yield FileFault(path, f"is unreliable ({problem})", again)
            continue
        if name == "sequences" and rows != len(names):
            yield FileFault(table, f"has {rows} rows for {len(names)} sequences", again)
    described = tree.root / "croissant.json"
    try:
        description = read_json(described)
    except (UserError, OSError, ValueError):
        description = None
    version = description.get("version") if isinstance(description, dict) else None
    with suppress(UserError, OSError, ValueError, KeyError):  # of tables that are told above
        if description != croissant(tree.root, tree.plan(), str(version)):
            yield FileFault(described, "differs from the plan and the tables", again)


def _list_faults(
    tree: Tree, names: list[str], splits: Mapping[str, list[str]], again: str
) -> Faults:
    """Yield faults of the lists of splits."""
    try:
        found = read_lists(tree.root, names)
    except UserError as problem:
        yield FileFault(tree.root / "splits", "are unreliable", str(problem))
        return
    for split in sorted(splits.keys() | found.keys()):
        if list(found.get(split, [None])) != splits.get(split, []):
            path = tree.root / "splits" / f"{split}.txt"
            yield FileFault(path, "is missing or differs from the records", again)


def _sequence_faults(dataset: Dataset, with_truth: bool, again: str) -> Faults:
    assert dataset.record
    remedy, stages = f"remove {dataset.record_path} and {again}", dataset.record.stages.values()
    faults = [each for entry in stages for each in _file_faults(dataset, entry, lambda _: remedy)]
    yield from faults if faults or not with_truth else _truth_faults(dataset)


def _machinery(record: SequenceRecord) -> str:
    """Return the software of a sequence with the requested backend, which may differ."""
    made = {stage: record.stages[stage].made_with for stage in MADE}
    backend = record.configuration.get("render", {}).get("backend")
    return json.dumps({"backend": backend, "made": made}, sort_keys=True)


def _mixture(tree: Tree, machinery: Mapping[str, str], again: str) -> Faults:
    """Yield sequences made by other software than most: their bytes are not of one program."""
    usual: dict[str, dict[str, dict[str, str]]] = {}
    for each, _ in Counter(machinery.values()).most_common():
        usual.setdefault(json.loads(each)["backend"], json.loads(each)["made"])
    for name, each in machinery.items():
        own = json.loads(each)
        most = usual[own["backend"]]
        changes = {stage: provenance_changes(most[stage], own["made"][stage]) for stage in MADE}
        if what := "; ".join(f"{stage}: {change}" for stage, change in changes.items() if change):
            yield FileFault(
                tree.record_path(name),
                f"was made by other software than most sequences ({what})",
                f"remove it and, with the program that made the others, {again}",
            )


def _truth_faults(dataset: Dataset) -> Faults:
    place = dataset.root / "truth" / dataset.sequence
    try:
        with silent():
            residuals = check_truth(dataset)
    except (UserError, ValueError) as problem:
        yield FileFault(place, f"cannot be rederived ({problem})", "regenerate the sequence")
        return
    for each in residuals:
        if not each.passed:
            yield FileFault(
                place,
                f"flow of {each.name} differs by {each.median:.2g} px from a second derivation",
                "this is a bug of megalopta; report it",
            )


def _unfinished(tree: Tree, again: str) -> Faults:
    staged = [each.folder for each in staged_sequences(tree)]
    if staged:
        yield FileFault(tree.staging, "holds unfinished sequences", again)
    for path in sorted(set(tree.staging.glob("*")) - set(staged)):
        yield FileFault(path, _STRANGE, "move it elsewhere")
    if tree.failures.exists():
        yield FileFault(tree.failures, "lists failed sequences", f"{again} --retry")
