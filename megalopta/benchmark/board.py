"""A leaderboard: a file of JSON lines, one for each program and pass."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from megalopta.benchmark.scores import Entry
from megalopta.core import bounded, files
from megalopta.core.errors import UserError
from megalopta.core.folders import locked
from megalopta.core.format_numbers import check_format


def read_board(path: Path) -> tuple[Entry, ...]:
    """Read the entries of a leaderboard; none where there is no file. Raises UserError."""
    try:
        lines = bounded.read_text(path).splitlines() if path.exists() else []
        return tuple(_entry(bounded.from_json(line), path) for line in lines)
    except (OSError, ValueError, AttributeError):
        raise UserError(f"{path} is no leaderboard, or damaged; give another file") from None


def add_entries(path: Path, entries: Iterable[Entry]) -> tuple[Entry, ...]:
    """Add entries, in the place of those of the same program, pass and truth; return all.

    Raises UserError when the file is something else.
    """
    new = tuple(entries)
    replaced = {_key(entry) for entry in new}
    with locked(path.parent):
        kept = tuple(each for each in read_board(path) if _key(each) not in replaced)
        files.write_text(path, "".join(f"{each.model_dump_json()}\n" for each in (*kept, *new)))
    return (*kept, *new)


def _entry(values: Any, path: Path) -> Entry:
    check_format("scores", values, path)
    return Entry.model_validate(values)


def _key(entry: Entry) -> tuple[str, str, str]:
    return entry.program, entry.pass_name, entry.truth_hash
