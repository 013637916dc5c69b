"""Output in the making, outside the tree: restarted or continued, and finally cleared.

.making/SEQ/            a sequence until it is complete; .making/SEQ-added/ more output of it
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
from megalopta.dataset.layout import Tree
from megalopta.dataset.publishing import Staging
from megalopta.dataset.record import KINDS, SequenceRecord, is_output, read_record
from megalopta.dataset.store import Dataset, file_hash
from megalopta.stages.registry import made_with

_ADDED = "-added"
_STAGED = re.compile(rf"(\d{{6,}})({_ADDED})?")


@dataclass(frozen=True)
class Staged(Staging):
    """Output in the making of one sequence."""

    sequence: str
    is_added: bool
    """True if it is more output of a finished sequence."""

    @classmethod
    def of(cls, tree: Tree, sequence: str, is_added: bool = False) -> "Staged":
        """Return the output in the making of a sequence of a tree."""
        folder = tree.staging / f"{sequence}{_ADDED if is_added else ''}"
        last = folder / "record.json", tree.record_path(sequence)
        return cls(tree.root, folder, folder / "data", last, sequence, is_added)

    def bring_in(
        self,
        configuration: Configuration,
        stages: Sequence[str],
        make: Callable[[Dataset], SequenceRecord],
    ) -> None:
        """Make it, or its missing parts, and move it into the tree, unless it is there."""
        with locked(self.folder), silent():
            if self.is_added or not self.last[1].exists():
                self.begin(made_with(stages, configuration), configuration)
                if not self.is_announced:
                    self.finish(make(Dataset(self.data, configuration)))
                self.publish()
            self.clear()

    def finish(self, record: SequenceRecord) -> None:
        """Declare all files of a record complete."""
        files.write_text(self.last[0], record.to_json())
        self.announce(self._moved(record))

    def publish(self) -> None:
        """Move finished output into the tree; an interrupted move is completed."""
        self.complete(partial(is_output, sequence=self.sequence))

    def is_over(self, keep_added: bool) -> bool:
        """True if it is no longer wanted."""
        if not self.is_added:
            return self.last[1].exists()
        return not self._is_wanted() if self.is_announced else not keep_added

    def _is_wanted(self) -> bool:
        """True if added output still belongs to the sequence, which may have been remade."""
        finished, there = self.last
        try:
            return read_record(finished, self.sequence).replaced == file_hash(there)
        except (OSError, UserError):
            return False

    def _moved(self, record: SequenceRecord) -> list[str]:
        """Folders that hold all files of a sequence and no others; for added output, all."""
        if self.is_added:
            made = (self.data / kind / self.sequence for kind in KINDS)
            parts = [
                each for folder in made if not folder.is_symlink() for each in folder.glob("*")
            ]
            return sorted(path.relative_to(self.data).as_posix() for path in parts)
        return record.folders


@contextmanager
def at_work(tree: Tree, plan: Plan, keep_added: bool = False) -> Iterator[list[str]]:
    """Lock and settle a tree; after the work inside, rebuild its index and tidy up.

    Unfinished added output is kept on request, until all work ends without a problem in the list
    yielded. Raises UserError if a record was modified.
    """
    problems: list[str] = []
    with locked(tree.root):
        tidy(tree, keep_added)
        _settle(tree, plan)
        yield problems
        write_index(tree, plan)
        tidy(tree, keep_added=bool(problems))


def _settle(tree: Tree, plan: Plan) -> None:
    """Settle interrupted work, until the manifest knows all records of a tree."""
    tree.sweep()
    manifest, names = tree.read_manifest(), tree.names()
    unknown = [name for name in names if not tree.is_known(name, manifest)]
    for name in unknown:
        tree.check_record(name, manifest)
    if manifest and (unknown or manifest.keys() - set(names)):
        write_index(tree, plan)


def tidy(tree: Tree, keep_added: bool = False) -> None:
    """Complete finished output, and remove unwanted output, outside the tree."""
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
    """Yield all output in the making."""
    for path in sorted(tree.staging.glob("*")):
        if (found := _STAGED.fullmatch(path.name)) and path.is_dir() and not path.is_symlink():
            yield Staged.of(tree, found[1], bool(found[2]))
