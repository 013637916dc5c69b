"""What is being made beside the tree: begun again or gone on with, and cleared when it is over.

.making/SEQ/            a sequence until it is whole; .making/SEQ-added/ more output of it
    data/               the files
    record.json         the record, which moves last (`dataset.publishing`)
"""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial

from megalopta.config.model import Configuration
from megalopta.config.recipe import Plan
from megalopta.core import files
from megalopta.core.errors import UserError
from megalopta.core.folders import locked
from megalopta.core.progress import silent
from megalopta.dataset.index import write_index
from megalopta.dataset.layout import Tree, is_record_known, read_manifest
from megalopta.dataset.publishing import Staging
from megalopta.dataset.record import KINDS, SequenceRecord, is_output, read_record
from megalopta.dataset.store import Dataset, file_hash
from megalopta.stages.registry import made_with

_ADDED = "-added"
_STAGED = re.compile(rf"(\d{{6,}})({_ADDED})?")


@dataclass(frozen=True)
class Staged(Staging):
    """What is being made of one sequence."""

    sequence: str
    is_added: bool
    """Whether it is more output of a sequence that is there."""

    @classmethod
    def of(cls, tree: Tree, sequence: str, is_added: bool = False) -> "Staged":
        """What is made of a sequence of a tree."""
        folder = tree.staging / f"{sequence}{_ADDED if is_added else ''}"
        last = folder / "record.json", tree.record_path(sequence)
        return cls(tree.root, folder, folder / "data", last, sequence, is_added)

    def bring_in(
        self,
        configuration: Configuration,
        stages: Sequence[str],
        make: Callable[[Dataset], SequenceRecord],
    ) -> None:
        """Make it, or what is missing of it, and move it into the tree, unless it is there."""
        with locked(self.folder), silent():
            if self.is_added or not self.last[1].exists():
                self.begin(made_with(stages, configuration), configuration)
                if not self.is_announced:
                    self.finish(make(Dataset(self.data, configuration)))
                self.publish()
            self.clear()

    def finish(self, record: SequenceRecord) -> None:
        """Note that all files of a record are there."""
        files.write_text(self.last[0], record.to_json())
        self.announce(self._moved(record))

    def publish(self) -> None:
        """Move what is finished into the tree; a move that was broken off is completed."""
        self.complete(partial(is_output, sequence=self.sequence))

    def is_over(self, keep_added: bool) -> bool:
        """Whether nobody wants it any more."""
        if not self.is_added:
            return self.last[1].exists()
        return not self._is_wanted() if self.is_announced else not keep_added

    def _is_wanted(self) -> bool:
        """Whether what is added is still of the sequence as it is: it may have been made again."""
        finished, there = self.last
        try:
            return read_record(finished, self.sequence).replaced == file_hash(there)
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
        end = f"/{self.sequence}"
        return list(dict.fromkeys(path.partition(f"{end}/")[0] + end for path in record.files))


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
        tree.check_record(name, manifest)
    if manifest and (unknown or manifest.keys() - set(names)):
        write_index(tree, plan)


def tidy(tree: Tree, keep_added: bool = False) -> None:
    """Complete what is finished, and remove what is over, of all that is beside the tree."""
    for staged in staged_sequences(tree):
        with locked(staged.folder):
            if staged.is_over(keep_added):
                staged.clear()
            elif staged.is_announced:
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
            yield Staged.of(tree, found[1], bool(found[2]))
