"""A leaderboard of scores: a file of JSON lines, one for each program and pass, and its print."""

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from rich.box import SIMPLE
from rich.table import Table

from megalopta.benchmark.scores import Entry, Groups, Scores
from megalopta.core import bounded, files
from megalopta.core.bounded import sentence
from megalopta.core.errors import UserError
from megalopta.core.folders import locked
from megalopta.core.format_numbers import check_format

_COLUMNS: Mapping[str, tuple[str, str]] = {
    "EPE": ("all", "epe_px"),
    "visible": ("visible", "epe_px"),
    "occluded": ("occluded", "epe_px"),
    "0–10": ("slow", "epe_px"),
    "10–40": ("medium", "epe_px"),
    "40+": ("fast", "epe_px"),
    "> 1 px %": ("all", "over_1px_percent"),
    "> 3 px %": ("all", "over_3px_percent"),
    "> 5 px %": ("all", "over_5px_percent"),
    "Fl %": ("all", "fl_percent"),
    "WAUC": ("all", "wauc_percent"),
    "angle °": ("all", "angular_deg"),
    "none %": ("all", "missing_percent"),
}


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


def score_table(scores: Scores) -> Table:
    """Return the errors of every sequence and overall, a block for each pass."""
    title = "Endpoint error over pixels, of those that move 0–10, 10–40, 40+ px per frame"
    table = _table(title, ("pass", "sequence"))
    for each in scores.entries:
        names = each.pass_name, "overall" if each.sequence is None else each.sequence
        style = "bold" if each.sequence is None else None
        table.add_row(*map(sentence, names), *_cells(each.errors), style=style)
        if each.sequence is None:
            table.add_section()
    return table


def board_table(entries: Iterable[Entry], truth_hash: str) -> Table:
    """Return the entries for one truth, the lowest EPE first, by pass."""
    table = _table("Leaderboard", ("pass", "program"))
    shown = [entry for entry in entries if entry.truth_hash == truth_hash]
    for entry in sorted(shown, key=lambda each: (each.pass_name, _epe(each))):
        table.add_row(sentence(entry.pass_name), sentence(entry.program), *_cells(entry.errors))
    return table


def _entry(values: Any, path: Path) -> Entry:
    check_format("scores", values, path)
    if "overall" in values:  # format 1
        values["errors"] = values.pop("overall")
    return Entry.model_validate(values)


def _key(entry: Entry) -> tuple[str, str, str]:
    return entry.program, entry.pass_name, entry.truth_hash


def _table(title: str, first: Iterable[str]) -> Table:
    table = Table(title=title, box=SIMPLE, padding=(0, 1))
    for name in first:
        table.add_column(name, no_wrap=True)
    for name in _COLUMNS:
        table.add_column(name, justify="right", no_wrap=True)
    return table


def _cells(groups: Groups) -> list[str]:
    values = (groups[group][name] for group, name in _COLUMNS.values())
    return ["–" if value is None else f"{value:.3g}" for value in values]


def _epe(entry: Entry) -> float:
    found = entry.errors["all"]["epe_px"]
    return math.inf if found is None else found
