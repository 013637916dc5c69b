"""The index of all that is finished, written anew from the records."""

import json
from contextlib import ExitStack

from megalopta import files
from megalopta.dataset import file_hash
from megalopta.plan import Plan
from megalopta.tree.croissant import croissant
from megalopta.tree.layout import Tree
from megalopta.tree.splits import SAMPLE, link_into_split, write_lists
from megalopta.tree.tables import TableWriter


def write_index(tree: Tree, plan: Plan) -> None:
    """Write manifest, tables, splits and Croissant file; one record is in memory at a time."""
    names: dict[str, list[str]] = {split: [] for split in plan.splits}
    names |= {SAMPLE: []} if plan.sample else {}
    with ExitStack() as open_files:
        temporary = open_files.enter_context(files.atomic_write(tree.root / "manifest.jsonl"))
        manifest = open_files.enter_context(temporary.open("w", encoding="utf-8"))
        tables = TableWriter(tree.root / "index", open_files)
        for record in tree.all_records():
            tables.add(record)
            line = {
                "sequence": record.sequence,
                "configuration": record.configuration_hash,
                "record": file_hash(tree.record_path(record.sequence)),
            }
            manifest.write(json.dumps(line) + "\n")
            sampled = [SAMPLE] if record.index < plan.sample else []
            for split in [record.split, *sampled]:
                names[split].append(record.sequence)
                link_into_split(tree.root, split, record)
        tables.finish()
    write_lists(tree.root, names)
    files.write_json(tree.root / "croissant.json", croissant(tree.root, plan))
