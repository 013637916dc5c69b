"""Scores in print."""

import math
from collections.abc import Iterable, Mapping

from rich.box import SIMPLE
from rich.table import Table

from megalopta.benchmark.scores import (
    Entry,
    GroupErrors,
    Groups,
    Scores,
)
from megalopta.core.bounded import sentence

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


def score_table(scores: Scores) -> Table:
    """Return the errors of every sequence and overall, a block for each pass."""
    title = "Endpoint error over pixels, of those that move 0–10, 10–40, 40+ px per frame"
    table = _table(title, ("pass", "sequence"))
    for entry, sequences in zip(scores.entries, scores.sequences, strict=True):
        for name, groups in sequences.items():
            table.add_row(sentence(entry.pass_name), sentence(name), *_cells(groups))
        table.add_row(sentence(entry.pass_name), "overall", *_cells(entry.overall), style="bold")
        table.add_section()
    return table


def board_table(entries: Iterable[Entry], truth_hash: str) -> Table:
    """Return the entries for one truth, the lowest EPE first, by pass."""
    table = _table("Leaderboard", ("pass", "program"))
    shown = [entry for entry in entries if entry.truth_hash == truth_hash]
    for entry in sorted(shown, key=lambda each: (each.pass_name, _epe(each))):
        table.add_row(sentence(entry.pass_name), sentence(entry.program), *_cells(entry.overall))
    return table


def _table(title: str, first: Iterable[str]) -> Table:
    table = Table(title=title, box=SIMPLE, padding=(0, 1))
    for name in first:
        table.add_column(name, no_wrap=True)
    for name in _COLUMNS:
        table.add_column(name, justify="right", no_wrap=True)
    return table


def _cells(groups: Groups) -> list[str]:
    return [_text(groups[group], name) for group, name in _COLUMNS.values()]


def _text(errors: GroupErrors, name: str) -> str:
    value = getattr(errors, name)
    return "–" if value is None else f"{value:.3g}"


def _epe(entry: Entry) -> float:
    found = entry.overall["all"].epe_px
    return math.inf if found is None else found
