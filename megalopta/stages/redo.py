"""Output made again beside the old one, which stays until the new one is whole.

DATASET/.redo is a dataset of its own: its links lead to the output that stays, its files are the
new ones. When all of them are there, `publish.json` in it lists what moves and what goes. From then
on whoever opens the dataset completes the move, so that a kill at any moment leaves either the old
output or the new.
"""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from megalopta import files
from megalopta.config import Configuration
from megalopta.dataset import REDO_FOLDER, Dataset, open_dataset, write_configuration
from megalopta.errors import UserError
from megalopta.folders import locked
from megalopta.stages.ledger import Ledger
from megalopta.stages.registry import STAGES

_BOOKS = ("dataset.yaml", "manifest.jsonl", "timings.json")


def begin_redo(old: Dataset, configuration: Configuration, stages: Sequence[str]) -> Dataset:
    """The dataset in which stages of another one are made again; what a kill left of it goes on."""
    new = Dataset(old.root / REDO_FOLDER, configuration)
    request = new.root / "request.json"
    wanted = {
        "models": {stage: STAGES[stage].model() for stage in stages},
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


def publish(old: Dataset, new: Dataset, stages: Sequence[str]) -> None:
    """Put finished output in the place of the old."""
    made = [path for stage in stages for path in Ledger(new).outputs(stage) if path.exists()]
    moves = [*(str(path.relative_to(new.root)) for path in made), *_BOOKS]
    gone = [path for stage in stages for path in Ledger(old).outputs(stage)]
    goes = {str(path.relative_to(old.root)) for path in gone} | {"report.html"}
    files.write_json(_plan(old.root), {"moves": moves, "goes": sorted(goes.difference(moves))})
    complete_redo(old.root)


def complete_redo(root: Path) -> None:
    """Complete the move of a dataset's new output where it was begun. Raises UserError."""
    plan = _plan(root)
    if not plan.exists():
        return
    moves, goes = _read_plan(plan)
    for name in moves:
        if (plan.parent / name).exists():
            files.remove(root / name)
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (plan.parent / name).rename(root / name)
    for name in goes:
        files.remove(root / name)
        _remove_if_empty((root / name).parent, root)
    discard(root)


def open_dataset_whole(root: Path) -> Dataset:
    """Open a dataset, after completing the move of new output if it was broken off."""
    if _plan(root).exists():
        with locked(root):
            complete_redo(root)
    return open_dataset(root)


def discard(root: Path) -> None:
    """Remove what was begun to be made again."""
    files.remove(root / REDO_FOLDER)


def _link(old: Dataset, new: Dataset) -> None:
    outputs = (path for stage in STAGES for path in Ledger(old).outputs(stage))
    for path in filter(Path.exists, outputs):
        link = new.root / path.relative_to(old.root)
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to(path.resolve(), target_is_directory=path.is_dir())
    new.root.mkdir(exist_ok=True)
    for name in _BOOKS:
        if (old.root / name).exists():
            shutil.copy(old.root / name, new.root / name)


def _plan(root: Path) -> Path:
    return root / REDO_FOLDER / "publish.json"


def _read_plan(path: Path) -> tuple[list[str], list[str]]:
    try:
        record = json.loads(path.read_text("utf-8"))
        moves, goes = ([str(name) for name in record[key]] for key in ("moves", "goes"))
    except (ValueError, KeyError, TypeError):
        raise UserError(f"{path} is damaged; remove the folder {path.parent}") from None
    if any(Path(name).is_absolute() or ".." in Path(name).parts for name in (*moves, *goes)):
        raise UserError(f"{path} leads out of the dataset; remove the folder {path.parent}")
    return moves, goes


def _read(path: Path) -> Any:
    try:
        return json.loads(path.read_text("utf-8"))
    except (OSError, ValueError):
        return None


def _remove_if_empty(folder: Path, root: Path) -> None:
    while folder != root and folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()
        folder = folder.parent
