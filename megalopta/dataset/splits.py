"""Splits: lists of names, and links that make an MPI-Sintel tree of each.

`splits/train/Sintel/training/flow/SEQ` leads to `training/flow/SEQ`, so that loaders of MPI-Sintel
read one split of a dataset. A copy with what the links lead to (`cp -rL`) stands for itself.
"""

import errno
from collections.abc import Collection
from pathlib import Path

from megalopta.core import bounded, files
from megalopta.core.errors import UserError
from megalopta.dataset.record import SequenceRecord

SAMPLE = "sample"
"""The split of the first few sequences."""
_NO_LINKS = (errno.EPERM, errno.ENOTSUP, errno.EOPNOTSUPP)


def link_into_split(root: Path, split: str, record: SequenceRecord) -> None:
    """Link the Sintel folders of a sequence into a split; where links cannot be made, none is."""
    kinds = {Path(path).parts[1] for path in record.files if path.startswith("training/")}
    for kind in sorted(kinds):
        link = root / "splits" / split / "Sintel" / "training" / kind / record.sequence
        if link.is_symlink():
            continue
        link.parent.mkdir(parents=True, exist_ok=True)
        try:
            link.symlink_to(Path("../../../../..") / "training" / kind / record.sequence)
        except OSError as problem:
            if problem.errno not in _NO_LINKS:
                raise


def write_lists(root: Path, names: dict[str, list[str]]) -> None:
    """Write splits/SPLIT.txt, a name a line."""
    for split, found in names.items():
        files.write_text(root / "splits" / f"{split}.txt", "".join(f"{name}\n" for name in found))


def read_lists(root: Path, known: Collection[str]) -> dict[str, tuple[str, ...]]:
    """Return the names of the sequences of every split; others than the known are refused."""
    found, known = {}, set(known)
    for path in sorted((root / "splits").glob("*.txt")):
        try:
            found[path.stem] = tuple(bounded.read_text(path).split())
        except ValueError:
            raise UserError(f"{path}: not a text file in UTF-8; {_remedy(root)}") from None
        if strangers := [name for name in found[path.stem] if name not in known]:
            raise UserError(
                f"{path}: no sequence {bounded.quoted(strangers[0], 60)!r}; {_remedy(root)}"
            )
    return found


def _remedy(root: Path) -> str:
    return f"write it again: megalopta dataset make {root} --out {root}"
