"""What is being made beside the tree: begun again or gone on with, and cleared when it is over.

.making/SEQ/            a sequence until it is whole; .making/SEQ-added/ more output of it
    request.json        what was asked for, and with what it is made: another is begun again
    data/               the files
    record.json         the record, which moves last
    publish.json        all is there, and moves (`dataset.publishing`)

Every step of this can be broken off, also by a kill, and is done again or gone on with by whoever
comes next.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from megalopta.config.model import Configuration, differences
from megalopta.config.recipe import Plan
from megalopta.core import files
from megalopta.core.errors import UserError
from megalopta.core.folders import LOCK_NAME, locked
from megalopta.core.progress import say, silent
from megalopta.dataset.index import write_index
from megalopta.dataset.layout import (
    Tree,
    changed_record,
    is_record_as_written,
    is_record_known,
    read_manifest,
)
from megalopta.dataset.publishing import PLAN, REQUEST, Move, read_request
from megalopta.dataset.record import KINDS, MADE, SequenceRecord, is_output, read_record
from megalopta.dataset.store import Dataset, file_hash
from megalopta.stages.registry import made_with

_ADDED = "-added"
_STAGED = re.compile(rf"(\d{{6,}})({_ADDED})?")


@dataclass(frozen=True)
class Staged:
    """What is being made of one sequence."""

    tree: Tree
    sequence: str
    is_added: bool = False
    """Whether it is more output of a sequence that is there."""

    @property
    def folder(self) -> Path:
        """Where it is made."""
        return self.tree.staging / f"{self.sequence}{_ADDED if self.is_added else ''}"

    @property
    def data(self) -> Path:
        """Its files, under the names that they have in the tree."""
        return self.folder / "data"

    def bring_in(
        self,
        configuration: Configuration,
        stages: Sequence[str],
        make: Callable[[Dataset], SequenceRecord],
    ) -> None:
        """Make it, or what is missing of it, and move it into the tree, unless it is there."""
        with locked(self.folder), silent():
            if self.is_added or not self.tree.record_path(self.sequence).exists():
                self.begin(configuration, stages)
                if not self.is_finished:
                    self.finish(make(Dataset(self.data, configuration)))
                self.publish()
            self.clear()

    def begin(self, configuration: Configuration, stages: Sequence[str] = MADE) -> None:
        """Note what is asked for; what was begun for other stages or otherwise is removed."""
        wanted = {
            "made_with": made_with(stages, configuration),
            "configuration": configuration.model_dump(mode="json"),
        }
        before = read_request(self.folder)
        if before != wanted:
            if before and (changes := differences(before, wanted)):
                told = "; ".join(changes[:3])
                say(f"{self.folder.name}: begun with others ({told}), and begun again")
            self.clear()
            files.write_json(self.folder / REQUEST, wanted)
        files.sweep(self.folder)

    def finish(self, record: SequenceRecord) -> None:
        """Note that all files of a record are there."""
        files.write_text(self._record, record.to_json())
        self._move.announce(self._moved(record))

    @property
    def is_finished(self) -> bool:
        """Whether all files are there, and move or have moved."""
        return (self.folder / PLAN).exists()

    def publish(self) -> None:
        """Move what is finished into the tree; a move that was broken off is completed."""
        self._move.complete(partial(is_output, sequence=self.sequence))

    def clear(self) -> None:
        """Remove everything but the lock, which its holder removes.

        What says how far it is goes first, so that nobody takes what a kill leaves for whole.
        """
        for name in (PLAN, self._record.name, REQUEST):
            files.remove(self.folder / name)
        for path in sorted(self.folder.iterdir()):
            if path.name != LOCK_NAME:
                files.remove(path)

    def is_over(self, keep_added: bool) -> bool:
        """Whether nobody wants it any more."""
        if not self.is_added:
            return self.tree.record_path(self.sequence).exists()
        return not self._is_wanted() if self.is_finished else not keep_added

    @property
    def _record(self) -> Path:
        return self.folder / "record.json"

    @property
    def _move(self) -> Move:
        last = self._record, self.tree.record_path(self.sequence)
        return Move(self.tree.root, self.folder, self.data, last)

    def _is_wanted(self) -> bool:
        """Whether what is added is still of the sequence as it is: it may have been made again."""
        try:
            replaced = read_record(self._record, self.sequence).replaced
            return replaced == file_hash(self.tree.record_path(self.sequence))
        except (OSError, UserError):
            return False

    def _moved(self, record: SequenceRecord) -> list[str]:
        """Folders that hold all files of a sequence and nothing else; of what is added, all."""
        if self.is_added:
            made = (self.data / kind / self.sequence for kind in KINDS)
            parts = [
                each for folder in made if not folder.is_symlink() for each in folder.glob("*")
            ]
            return sorted(path.relative_to(self.data).as_posix() for path in parts)
        return list(dict.fromkeys(_folder(path, self.sequence) for path in record.files))


def _folder(path: str, sequence: str) -> str:
    parts = Path(path).parts
    return str(Path(*parts[: parts.index(sequence) + 1]))


@contextmanager
def at_work(tree: Tree, plan: Plan, keep_added: bool = False) -> Iterator[list[str]]:
    """Keep others out of a tree and settle it; after the work inside, write its index and tidy it.

    What is added and not finished is kept where it is asked for, until all the work is done without
    a problem in the list yielded. Raises UserError when somebody changed a record.
    """
    problems: list[str] = []
    with locked(tree.root):
        tidy(tree, keep_added)
        _settle(tree, plan)
        yield problems
        write_index(tree, plan)
        tidy(tree, keep_added=bool(problems))


def _settle(tree: Tree, plan: Plan) -> None:
    """Bring a tree to where its manifest knows all its records, after whatever was broken off."""
    tree.sweep()
    manifest, names = read_manifest(tree.root), tree.names()
    unknown = [name for name in names if not is_record_known(tree.record_path(name), manifest)]
    for name in unknown:
        if not is_record_as_written(tree.record_path(name), manifest):
            raise UserError(changed_record(tree, name))
    if manifest and (unknown or manifest.keys() - set(names)):
        write_index(tree, plan)


def tidy(tree: Tree, keep_added: bool = False) -> None:
    """Complete what is finished, and remove what is over, of all that is beside the tree."""
    for staged in staged_sequences(tree):
        with locked(staged.folder):
            if staged.is_over(keep_added):
                staged.clear()
            elif staged.is_finished:
                staged.publish()
                staged.clear()
        if not any(staged.folder.iterdir()):
            staged.folder.rmdir()
    if tree.staging.is_dir() and not any(tree.staging.iterdir()):
        tree.staging.rmdir()


def staged_sequences(tree: Tree) -> Iterator[Staged]:
    """Yield what is being made."""
    for path in sorted(tree.staging.glob("*")):
        if (found := _STAGED.fullmatch(path.name)) and path.is_dir() and not path.is_symlink():
            yield Staged(tree, found[1], bool(found[2]))
