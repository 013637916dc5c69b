"""The index of all that is finished, written anew from the records."""

from collections.abc import Mapping
from contextlib import ExitStack

from megalopta.config.recipe import Plan
from megalopta.core import files
from megalopta.core.errors import DamagedFileError
from megalopta.dataset.croissant import croissant
from megalopta.dataset.layout import Tree
from megalopta.dataset.manifest import NAME, write_line
from megalopta.dataset.record import SequenceRecord
from megalopta.dataset.splits import SAMPLE, link_into_split, write_lists
from megalopta.dataset.tables import TableWriter


def write_index(tree: Tree, plan: Plan) -> None:
    """Write manifest, tables, splits and Croissant file; one record is in memory at a time."""
    names: dict[str, list[str]] = {split: [] for split in plan.splits}
    names |= {SAMPLE: []} if plan.sample else {}
    with ExitStack() as open_files:
        temporary = open_files.enter_context(files.atomic_write(tree.root / NAME))
        manifest = open_files.enter_context(temporary.open("w", encoding="utf-8"))
        tables = TableWriter(tree.root / "index", open_files)
        for record in tree.all_records():
            _check_split(tree, record, names)
            tables.add(record)
            write_line(manifest, record, tree.record_path(record.sequence))
            sampled = [SAMPLE] if record.index < plan.sample else []
            for split in [record.split, *sampled]:
                names[split].append(record.sequence)
                link_into_split(tree.root, split, record)
        tables.finish()
    write_lists(tree.root, names)
    files.write_json(tree.root / "croissant.json", croissant(tree.root, plan))


def _check_split(tree: Tree, record: SequenceRecord, names: Mapping[str, object]) -> None:
    if record.split not in names:
        raise DamagedFileError(
            f"{tree.record_path(record.sequence)} is damaged (split {record.split!r} is none of "
            "the plan); remove it and run megalopta dataset make again"
        )
