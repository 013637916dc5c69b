"""`megalopta check files`: every file of a dataset against the manifest, and arrays' shapes."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import zarr
from rich.console import Console

from megalopta.benchmark.ranking_run import FOLDER
from megalopta.core.progress import progress
from megalopta.dataset.store import (
    Dataset,
    files_in,
    is_as_written,
    whole_of,
)
from megalopta.render import read_size
from megalopta.stages.ledger import Ledger
from megalopta.stages.registry import STAGES

_OWN = ("dataset.yaml", "manifest.jsonl", "timings.json", "report.html")


@dataclass(frozen=True)
class Fault:
    """Something that is not as it was written."""

    path: Path
    what: str
    remedy: str
    """How to mend it."""


def run_check_files(dataset: Dataset, console: Console | None = None) -> bool:
    """Check a dataset and print what is damaged; return whether nothing is."""
    console = console or Console()
    faults = check_files(dataset)
    for fault in faults:
        console.print(
            f"{fault.path}: {fault.what}; {fault.remedy}", markup=False, highlight=False,
            soft_wrap=True,
        )  # fmt: skip
    entries = {stage: Ledger(dataset).entry(stage) for stage in STAGES}
    finished = [stage for stage, entry in entries.items() if entry]
    total = sum(len(entry["files"]) for entry in entries.values() if entry)
    console.print(
        f"{total} files of {', '.join(finished) or 'no finished stage'}: "
        f"{len(faults) or 'none'} damaged, missing or unknown"
    )
    return not faults


def check_files(dataset: Dataset) -> list[Fault]:
    """Compare hashes of all files with the manifest, and shapes with the configuration.

    A stage that is not finished has no hashes yet; its files are not checked.
    """
    known: set[Path] = set()
    faults: dict[Path, Fault] = {}
    ledger = Ledger(dataset)
    for stage in STAGES:
        entry = ledger.entry(stage)
        if entry is None:
            known.update(files_in(ledger.outputs(stage)))
            continue
        written = {dataset.root / name: tuple(each) for name, each in entry["files"].items()}
        known.update(written)
        with progress(f"Checking files of {stage}", len(written), "file") as advance:
            for path, (size, digest) in written.items():
                if what := _damage(dataset, path, size, digest):
                    whole = whole_of(path, dataset.root)
                    faults[whole] = Fault(path, what, _again(dataset, stage, whole))
                advance()
    return [*faults.values(), *_unknown(dataset, known)]


def _damage(dataset: Dataset, path: Path, size: int, digest: str) -> str | None:
    if not path.is_file():
        return "is missing"
    if not is_as_written(path, size, digest):
        return "is not as it was written"
    return wrong_shape(dataset, path)


def wrong_shape(dataset: Dataset, path: Path) -> str | None:
    """What is wrong with the size of a file of a dataset; None where nothing is, or it has none."""
    camera = dataset.configuration.camera
    size = (camera.height, camera.width)
    try:
        if path.suffix == ".exr" and (found := read_size(path)) != size:
            return f"has {found[1]} × {found[0]} px instead of {size[1]} × {size[0]}"
        if path.name == "zarr.json" and path.parent.parent.name == dataset.sequence:
            shape = _shape_of_counts(path.parent)
            wanted = (dataset.configuration.trajectory.frames, *size)
            if shape not in (None, wanted):
                return f"has counts of shape {shape} instead of {wanted}"
    except (OSError, ValueError, KeyError, RecursionError) as problem:
        return f"cannot be read ({problem})"
    return None


def _shape_of_counts(store: Path) -> tuple[int, ...] | None:
    group = zarr.open_group(store, mode="r")
    counts = group.get("counts")
    return tuple(counts.shape) if isinstance(counts, zarr.Array) else None


def _again(dataset: Dataset, stage: str, whole: Path) -> str:
    root = dataset.root
    out = f" --out {root}" if stage == "render" else ""
    command = f"{STAGES[stage].command} {root}{out}"
    remove = f"remove {whole} and " if whole.exists() else ""
    return f"{remove}run: megalopta {command}"


def _unknown(dataset: Dataset, known: set[Path]) -> Iterator[Fault]:
    own = {dataset.root / name for name in _OWN}
    own |= set(files_in([dataset.root / FOLDER]))
    for path in sorted(set(files_in([dataset.root])) - known - own):
        yield Fault(path, "belongs to no stage of this dataset", "move it elsewhere")
