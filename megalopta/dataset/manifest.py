"""The manifest: which sequences there are, and the hash of each one's record.

What it says holds: a record of another hash was changed by somebody. There are two exceptions,
which a run that was killed before it wrote the manifest leaves: a record that it does not know yet,
and one that says itself that it took the place of the record that it knows.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import IO

from megalopta.core import bounded
from megalopta.core.errors import UserError
from megalopta.dataset.record import SequenceRecord, read_record
from megalopta.dataset.store import file_hash

NAME = "manifest.jsonl"


def read_manifest(root: Path) -> dict[str, str]:
    """Return the hash of every record by the name of its sequence. Raises UserError."""
    path = root / NAME
    try:
        lines = map(bounded.from_json, bounded.read_text(path).splitlines())
        return {str(line["sequence"]): str(line["record"]) for line in lines}
    except FileNotFoundError:
        return {}
    except (ValueError, KeyError, TypeError):
        raise UserError(
            f"{path} is damaged; restore it, or remove it to take the records as they are, and run "
            f"megalopta dataset make {root} --out {root}"
        ) from None


def write_line(manifest: IO[str], record: SequenceRecord, path: Path) -> None:
    """Write the line of a sequence whose record is at a path."""
    line = {
        "sequence": record.sequence,
        "configuration": record.configuration_hash,
        "record": file_hash(path),
    }
    manifest.write(json.dumps(line) + "\n")


def is_record_known(path: Path, manifest: Mapping[str, str]) -> bool:
    """Whether the manifest has the record at a path as it is."""
    return manifest.get(path.stem) == _hash(path)


def is_record_as_written(path: Path, manifest: Mapping[str, str]) -> bool:
    """Whether the record at a path is what the program wrote. Raises UserError."""
    known = manifest.get(path.stem)
    return known in (None, _hash(path)) or read_record(path, path.stem).replaced == known


def _hash(path: Path) -> str:
    bounded.check_file(path, bounded.TEXT_BYTES)
    return file_hash(path)
