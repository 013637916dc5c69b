"""Output made again beside the old one, which stays until the new one is whole.

DATASET/.redo is a dataset of its own: its links lead to the output that stays, its files are the
new ones. When all of them are there, `publish.json` in it lists what moves and what goes. From then
on whoever runs a stage completes the move first, and whoever only reads is refused, so that a kill
at any moment leaves either the old output or the new.
"""

import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from megalopta.config.model import Configuration
from megalopta.core import bounded, files
from megalopta.core.enclosure import check_enclosed, check_no_links
from megalopta.core.errors import UserError
from megalopta.core.folders import locked
from megalopta.dataset.store import (
    REDO_FOLDER,
    Dataset,
    moving_plan,
    open_sequence,
    read_dataset,
    write_configuration,
)
from megalopta.stages.ledger import Ledger
from megalopta.stages.origins import provenance
from megalopta.stages.registry import STAGES

_LAST = "dataset.yaml"
"""Moves last: as long as it is there, something is left to do."""


def begin_redo(old: Dataset, configuration: Configuration, stages: Sequence[str]) -> Dataset:
    """The dataset in which stages of another one are made again; what a kill left of it goes on."""
    new = Dataset(old.root / REDO_FOLDER, configuration)
    request = new.root / "request.json"
    wanted = {
        "models": {stage: provenance(stage, configuration) for stage in stages},
        "configuration": configuration.model_dump(mode="json"),
    }
    if _read(request) != wanted:
        discard(old.root)
        _link(old, Dataset(new.root, old.configuration))
        Ledger(Dataset(new.root, old.configuration)).forget(*stages)
        write_configuration(new)
        files.write_json(request, wanted)
    files.sweep(new.root)
    return new


def publish(old: Dataset, new: Dataset, stages: Sequence[str], doomed: Sequence[str]) -> None:
    """Put finished output of stages in the place of the old, of which some stages' is doomed."""
    made = {path for stage in (*stages, *doomed) for path in Ledger(new).outputs(stage)}
    made |= {new.root / name for name in _books(new) if name != _LAST}
    moves = {_name(path, new) for path in made if path.exists() and not path.is_symlink()}
    gone = {_name(path, old) for stage in doomed for path in Ledger(old).outputs(stage)}
    goes = (gone | {"report.html", _name(old.record_path, old)}).difference(moves)
    files.write_json(moving_plan(old.root), {"moves": sorted(moves), "goes": sorted(goes)})
    complete_redo(old.root)


def complete_redo(root: Path) -> None:
    """Complete the move of a dataset's new output where it was begun; the caller has locked it.

    Raises
    ------
    UserError
        When what is to move or to go is no output of this dataset.
    """
    new = root / REDO_FOLDER
    if not os.path.lexists(moving_plan(root)):
        return
    if (new / _LAST).exists():
        moves, goes = _read_plan(root)
        for name in moves:
            _move(new / name, root / name)
        for name in goes:
            files.remove(root / name)
            _remove_if_empty((root / name).parent, root)
        _move(new / _LAST, root / _LAST)
    discard(root)


def finish_move(root: Path) -> None:
    """Complete the move of new output if it was broken off, before a stage works. Raises UserError.

    Reading does not: `open_sequence` refuses such a folder.
    """
    if os.path.lexists(moving_plan(root)):
        check_enclosed(root)
        with locked(root):
            complete_redo(root)


def open_dataset_whole(root: Path) -> Dataset:
    """Open a dataset to work on it, after completing a move that was broken off."""
    finish_move(root)
    return open_sequence(root)


def discard(root: Path) -> None:
    """Remove what was begun to be made again."""
    files.remove(root / REDO_FOLDER)


def _link(old: Dataset, new: Dataset) -> None:
    outputs = (path for stage in STAGES for path in Ledger(old).outputs(stage))
    for path in filter(Path.exists, outputs):
        link = new.root / path.relative_to(old.root)
        link.parent.mkdir(parents=True, exist_ok=True)
        target = os.path.relpath(path.resolve(), link.parent.resolve())
        link.symlink_to(target, target_is_directory=path.is_dir())
    new.root.mkdir(exist_ok=True)
    for name in _books(old):
        if (old.root / name).exists():
            (new.root / name).parent.mkdir(exist_ok=True)
            shutil.copy(old.root / name, new.root / name)


def _books(dataset: Dataset) -> tuple[str, ...]:
    """What a dataset holds beside the output of its stages."""
    return "timings.json", _name(dataset.record_path, dataset), _LAST


def _name(path: Path, dataset: Dataset) -> str:
    return str(path.relative_to(dataset.root))


def _move(source: Path, target: Path) -> None:
    if source.exists():
        files.remove(target)
        target.parent.mkdir(parents=True, exist_ok=True)
        source.rename(target)


def _read_plan(root: Path) -> tuple[list[str], list[str]]:
    """What moves and what goes, if it is output of the dataset as it was or as it will be."""
    path, new = moving_plan(root), root / REDO_FOLDER
    remedy = f"remove the folder {new}"
    try:
        record = bounded.read_json(path)
        moves, goes = ([str(name) for name in record[key]] for key in ("moves", "goes"))
        outputs = _output_names(read_dataset(root)) | _output_names(read_dataset(new))
        for name in moves:
            check_no_links(new / name)  # what a link leads to changes with its place
    except UserError as problem:
        raise UserError(f"{path} cannot be followed ({problem}); {remedy}") from None
    except (ValueError, KeyError, TypeError):
        raise UserError(f"{path} is damaged; {remedy}") from None
    outputs |= {"report.html"}
    for name in (*moves, *goes):
        if name not in outputs or not all(_is_plain(root, base, name) for base in (root, new)):
            raise UserError(f"{path}: {bounded.quoted(name)} is no output of a stage; {remedy}")
    return moves, goes


def _is_plain(root: Path, base: Path, name: str) -> bool:
    """Whether no folder between the root and something in it is a link."""
    folder = (base / name).parent
    real = Path(os.path.realpath(root), folder.relative_to(root))
    return Path(os.path.realpath(folder)) == real


def _output_names(dataset: Dataset) -> set[str]:
    outputs = {_name(path, dataset) for stage in STAGES for path in Ledger(dataset).outputs(stage)}
    return outputs | {*_books(dataset)}


def _read(path: Path) -> Any:
    try:
        return bounded.read_json(path)
    except (OSError, ValueError):
        return None


def _remove_if_empty(folder: Path, root: Path) -> None:
    while folder != root and folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()
        folder = folder.parent
