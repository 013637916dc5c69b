"""The index of all that is finished, written anew from the records: manifest, tables and splits.

`splits/train/Sintel/training/flow/SEQ` leads to `training/flow/SEQ`, so that loaders of MPI-Sintel
read one split of a dataset. A copy with what the links lead to (`cp -rL`) stands for itself.
"""

import errno
import json
from collections.abc import Collection
from contextlib import ExitStack
from pathlib import Path

from megalopta.config.recipe import Plan
from megalopta.core import bounded, files
from megalopta.core.errors import DamagedFileError, UserError
from megalopta.dataset.layout import MANIFEST, Tree
from megalopta.dataset.record import SequenceRecord
from megalopta.dataset.store import file_hash
from megalopta.dataset.tables import TableWriter, croissant

_SAMPLE = "sample"
"""The split of the first few sequences."""
_NO_LINKS = (errno.EPERM, errno.ENOTSUP, errno.EOPNOTSUPP)


def write_index(tree: Tree, plan: Plan) -> None:
    """Write manifest, tables, splits and Croissant file; one record is in memory at a time."""
    names: dict[str, list[str]] = {split: [] for split in plan.splits}
    names |= {_SAMPLE: []} if plan.sample else {}
    with ExitStack() as open_files:
        temporary = open_files.enter_context(files.atomic_write(tree.root / MANIFEST))
        manifest = open_files.enter_context(temporary.open("w", encoding="utf-8"))
        tables = TableWriter(tree.root / "index", open_files)
        for record in tree.all_records():
            if record.split not in names:
                raise DamagedFileError(
                    f"{tree.record_path(record.sequence)} is damaged (split {record.split!r} is "
                    "none of the plan); remove it and run megalopta dataset make again"
                )
            tables.add(record)
            line = {
                "sequence": record.sequence,
                "configuration": record.configuration_hash,
                "record": file_hash(tree.record_path(record.sequence)),
            }
            manifest.write(json.dumps(line) + "\n")
            sampled = [_SAMPLE] if record.index < plan.sample else []
            for split in [record.split, *sampled]:
                names[split].append(record.sequence)
                _link_into_split(tree.root, split, record)
        tables.finish()
    for split, found in names.items():
        lines = "".join(f"{name}\n" for name in found)
        files.write_text(tree.root / "splits" / f"{split}.txt", lines)
    files.write_json(tree.root / "croissant.json", croissant(tree.root, plan))


def _link_into_split(root: Path, split: str, record: SequenceRecord) -> None:
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
