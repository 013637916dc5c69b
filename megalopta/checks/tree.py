"""`megalopta dataset check`: a dataset of many sequences against its records and its plan.

Every file against its hash, shapes against the configuration, the records against the manifest, the
index against the Croissant file, and of a few sequences the truth derived another way.
"""

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path

import pyarrow.parquet as pq
from rich.console import Console

from megalopta import files
from megalopta.checks.integrity import Fault, wrong_shape
from megalopta.checks.truth import check_truth
from megalopta.dataset import file_hash, files_in, whole_of
from megalopta.errors import UserError
from megalopta.plan import sequence_name
from megalopta.progress import progress, silent
from megalopta.tree import SequenceRecord, Tree

_OWN = ("dataset.yaml", "manifest.jsonl", "croissant.json", "README.md", "index.html")
_OWN_FOLDERS = ("index", "splits", "sequences", "card")


def run_check_tree(root: Path, truths: int, console: Console | None = None) -> bool:
    """Check a dataset, with the truth of so many sequences; print what is wrong, return if nothing.

    Raises UserError where there is no dataset of many sequences.
    """
    console, tree = console or Console(), Tree(root)
    faults = check_tree(tree, truths)
    for fault in faults:
        console.print(
            f"{fault.path}: {fault.what}; {fault.remedy}", markup=False, highlight=False,
            soft_wrap=True,
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
    faults += _index_faults(tree, names)
    known: set[Path] = set()
    chosen = set(names[:: max(1, len(names) // truths)][:truths]) if truths else set()
    with progress("Checking sequences", len(names), "sequence") as advance:
        for name in names:
            try:
                record = tree.record(name)
            except UserError as problem:
                faults.append(Fault(tree.record_path(name), "is damaged", str(problem)))
                continue
            known.update(tree.root / path for path in record.files)
            faults += _file_faults(tree, record)
            if name in chosen and not any(name in fault.path.parts for fault in faults):
                faults += _truth_faults(tree, record)
            advance()
    return [*faults, *_unknown(tree, known)]


def _unmade(tree: Tree, sequences: int, names: list[str]) -> Iterator[Fault]:
    missing = sequences - len(names)
    if missing > 0:
        there = set(names)
        first = next(n for n in map(sequence_name, range(sequences)) if n not in there)
        yield Fault(
            tree.record_path(first),
            f"{missing} sequences of the plan are not made, this is the first",
            f"run: megalopta dataset make {tree.root} --out {tree.root}",
        )


def _index_faults(tree: Tree, names: list[str]) -> Iterator[Fault]:
    again = f"run: megalopta dataset make {tree.root} --out {tree.root}"
    manifest, described = tree.root / "manifest.jsonl", tree.root / "croissant.json"
    try:
        lines = map(json.loads, manifest.read_text("utf-8").splitlines())
        hashes = {line["sequence"]: line["record"] for line in lines}
    except (OSError, ValueError, KeyError, TypeError):
        yield Fault(manifest, "is missing or damaged", again)
        return
    if sorted(hashes) != names:
        yield Fault(manifest, f"lists {len(hashes)} sequences, there are {len(names)}", again)
    for name in set(names) & hashes.keys():
        if file_hash(tree.record_path(name)) != hashes[name]:
            yield Fault(
                tree.record_path(name), "is not as it was written", f"remove it and {again}"
            )
    try:
        parts = json.loads(described.read_text("utf-8"))["distribution"]
        for part in (each for each in parts if "sha256" in each):
            table = tree.root / part["contentUrl"]
            if hashlib.sha256(table.read_bytes()).hexdigest() != part["sha256"]:
                yield Fault(table, "is not as it was written", again)
            elif part["name"] == "sequences.parquet":
                rows = pq.read_metadata(table).num_rows
                if rows != len(names):
                    yield Fault(table, f"has {rows} rows for {len(names)} sequences", again)
    except (OSError, ValueError, KeyError, TypeError) as problem:
        yield Fault(described, f"or a table of it is missing or damaged ({problem})", again)


def _file_faults(tree: Tree, record: SequenceRecord) -> list[Fault]:
    dataset, faults = tree.dataset(record), dict[Path, Fault]()
    remedy = (
        f"remove {tree.record_path(record.sequence)} and run: megalopta dataset make {tree.root} "
        f"--out {tree.root}"
    )
    for name, (size, hashed) in record.files.items():
        path = tree.root / name
        if not path.is_file():
            what: str | None = "is missing"
        elif path.stat().st_size != size or file_hash(path) != hashed:
            what = "is not as it was written"
        else:
            what = wrong_shape(dataset, path)
        if what:
            faults[whole_of(path, tree.root)] = Fault(path, what, remedy)
    return list(faults.values())


def _truth_faults(tree: Tree, record: SequenceRecord) -> Iterator[Fault]:
    with silent():
        residuals = check_truth(tree.dataset(record))
    for each in residuals:
        if not each.passed:
            yield Fault(
                tree.root / "truth" / record.sequence,
                f"flow of {each.name} differs by {each.median:.2g} px from another derivation",
                "the program has a fault there, tell its authors",
            )


def _unknown(tree: Tree, known: set[Path]) -> Iterator[Fault]:
    if tree.staging.exists():
        yield Fault(
            tree.staging,
            "holds sequences that are not finished",
            f"run: megalopta dataset make {tree.root} --out {tree.root}",
        )
    if tree.failures.exists():
        yield Fault(
            tree.failures,
            "lists sequences that could not be made",
            f"run: megalopta dataset make {tree.root} --out {tree.root} --retry",
        )
    own = {tree.root / name for name in _OWN} | {tree.failures}
    folders = {*_OWN_FOLDERS, tree.staging.name}
    for top in tree.root.iterdir():
        if top.name in folders or files.is_temporary(top):
            continue
        for path in sorted(set(files_in([top])) - known - own):
            yield Fault(path, "belongs to no sequence of this dataset", "move it elsewhere")
