"""Recomputed output next to the old one, which stays until the new one is complete.

DATASET/.redo is a dataset of its own: its links lead to unchanged output, its files are new. When
all are complete they move (`dataset.publishing`). Meanwhile readers are refused, so that a kill at
any moment leaves either the old output or the new.
"""

import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path

from megalopta.config.model import Configuration
from megalopta.core import files
from megalopta.core.folders import check_enclosed, locked
from megalopta.dataset.publishing import Staging, link
from megalopta.dataset.store import (
    REDO_FOLDER,
    Dataset,
    open_sequence,
    read_dataset,
    write_configuration,
)
from megalopta.stages.ledger import Ledger
from megalopta.stages.registry import STAGES, made_with

_LAST = "dataset.yaml"
"""Moves last: while it exists, the move is unfinished."""


def begin_redo(old: Dataset, configuration: Configuration, stages: Sequence[str]) -> Dataset:
    """Return the dataset in which stages of another are redone; continues what a kill left."""
    new = Dataset(old.root / REDO_FOLDER, configuration)

    def prepare() -> None:
        for name in _there(old.root, _outputs(old)):
            link(old.root, new.root, name)
        new.root.mkdir(exist_ok=True)
        for name in _there(old.root, _books(old)):
            (new.root / name).parent.mkdir(exist_ok=True)
            shutil.copy(old.root / name, new.root / name)
        Ledger(Dataset(new.root, old.configuration)).forget(*stages)
        write_configuration(new)

    _staging(old.root).begin(made_with(stages, configuration), configuration, prepare)
    return new


def publish(old: Dataset, new: Dataset, stages: Sequence[str], doomed: Sequence[str]) -> None:
    """Replace output of stages by the new one; output of some stages is doomed."""
    made = _there(new.root, _outputs(new, (*stages, *doomed)) | _books(new) - {_LAST})
    moves = {name for name in made if not (new.root / name).is_symlink()}
    gone = _outputs(old, doomed) | _books(old) - {_LAST, "timings.json"} | {"report.html"}
    _staging(old.root).announce(moves, gone - moves)
    complete_redo(old.root)


def complete_redo(root: Path) -> None:
    """Complete the move of a dataset's new output; the caller has locked the dataset.

    Raises UserError if a file to move or remove is no output of this dataset.
    """
    staging = _staging(root)
    if staging.is_announced:
        if staging.last[0].exists():
            known = {"report.html"}
            for each in map(read_dataset, (root, staging.data)):
                known |= _outputs(each) | _books(each)
            staging.complete(known.__contains__)
        discard(root)


def finish_move(root: Path) -> None:
    """Complete an interrupted move of new output before a stage works. Raises UserError.

    Reading does not: `open_sequence` refuses such a folder.
    """
    if _staging(root).is_announced:
        check_enclosed(root)
        with locked(root):
            complete_redo(root)


def open_dataset_whole(root: Path) -> Dataset:
    """Open a dataset to work on it, after completing an interrupted move."""
    finish_move(root)
    return open_sequence(root)


def discard(root: Path) -> None:
    """Remove unfinished new output."""
    files.remove(root / REDO_FOLDER)


def _books(dataset: Dataset) -> set[str]:
    """Files of a dataset that are no output of its stages."""
    return {"timings.json", str(dataset.record_path.relative_to(dataset.root)), _LAST}


def _outputs(dataset: Dataset, stages: Iterable[str] = STAGES) -> set[str]:
    paths = (path for stage in stages for path in STAGES[stage].outputs(dataset))
    return {str(path.relative_to(dataset.root)) for path in paths}


def _there(root: Path, names: Iterable[str]) -> list[str]:
    return [name for name in names if (root / name).exists()]


def _staging(root: Path) -> Staging:
    new = root / REDO_FOLDER
    return Staging(root, new, new, (new / _LAST, root / _LAST))
