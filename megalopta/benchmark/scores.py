"""Scores of flow files, or of a method's flow: by sequence and overall, for every pass.

A leaderboard is a file of JSON lines, one per program and pass.
"""

import math
import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from numpy.typing import NDArray
from pydantic import FiniteFloat, NonNegativeInt, PositiveInt
from rich.box import SIMPLE
from rich.table import Table

from megalopta.benchmark import clips
from megalopta.core import bounded, files
from megalopta.core.bounded import sentence
from megalopta.core.errors import UserError
from megalopta.core.folders import locked
from megalopta.core.format_numbers import check_format, written
from megalopta.core.freshness import digest
from megalopta.core.pictures import read_codes
from megalopta.core.progress import progress
from megalopta.core.record import Record
from megalopta.dataset.store import file_hash
from megalopta.flow.detectors.gray_detector import DenseDetector
from megalopta.flow.detectors.registry import Method, method
from megalopta.flow.formats import KITTI_SCALE, read_flow
from megalopta.flow.metrics.endpoint_error import GROUPS, DenseErrors
from megalopta.flow.metrics.response_error import for_json

Answers = Mapping[clips.FrameName, tuple[str, Callable[[], NDArray[Any]]]]
"""Source of a frame's flow, and a function that returns it, (H, W, 2) in px"""

Groups = Mapping[str, Mapping[str, int | FiniteFloat | None]]
"""Fields of `flow.metrics.DenseError` by group of pixels (`flow.metrics.GROUPS`); None if a group
has no pixel"""


class Entry(Record, frozen=True):
    """A row of the table of scores: a program's flow over one pass, of all or of one sequence."""

    format: NonNegativeInt = written("scores")
    """Format of this row (`format_numbers`)"""
    program: str
    pass_name: str
    """Sintel's "clean" or "final"; empty without passes"""
    sequence: str | None = None
    """None: over all sequences, as in a leaderboard"""
    truth: str
    """Name of the folder of the true flow"""
    truth_hash: str
    """Hash of the true flow; only entries with the same one are comparable"""
    frames: PositiveInt
    errors: Groups


class Scores(Record, frozen=True):
    """The table: for each pass an entry per sequence, then one over all."""

    format: NonNegativeInt = written("scores")
    """Format of this file (`format_numbers`)"""
    entries: tuple[Entry, ...]

    @property
    def overall(self) -> tuple[Entry, ...]:
        """Entries over all sequences, by pass."""
        return tuple(each for each in self.entries if each.sequence is None)


def score_submission(
    flow: str | Path | Method,
    truth: str | Path,
    program: str | None = None,
    png_scale: float = KITTI_SCALE,
) -> Scores:
    """Score flow against the true flow of a dataset.

    Raises UserError if frames have no file or files no frame, or a file is damaged or of another
    size.

    Parameters
    ----------
    flow
        Folder of `.flo`, `.flo5`, `.pfm`, `.npy` or KITTI's PNG files (px per frame), in the
        layout of Sintel (with or without a folder for each pass), KITTI or Middlebury. Or a
        method to run on the truth's own frames: a name, `module:function`, ONNX file, or a
        function from Python.
    truth
        Folder of a dataset of megalopta, of Sintel, KITTI, Middlebury, Spring or FlyingChairs.
    program
        Name of the program that wrote the flow; default: that of its folder, or of the method.
    png_scale
        Codes of a pixel in flow as PNG, true or not: 64 in KITTI, 128 in DSEC.
    """
    truth = Path(truth)
    if not truth.is_dir():
        raise UserError(f"{truth}: no such folder")
    truths = clips.true_flows(truth, png_scale)
    name, passes = _answers_of(flow, truths, png_scale)
    with progress("Scoring flow", len(truths), "frame") as advance:
        found, digest_of_all = _scored(passes, truths, advance)

    shared = {
        "program": program or name,
        "truth": truth.resolve().name,
        "truth_hash": digest_of_all,
    }
    frames, entries = Counter(frame.sequence for frame in truths), []
    for pass_name, by_sequence in found.items():
        overall = None, DenseErrors.joined(by_sequence.values())
        every: list[tuple[str | None, DenseErrors]] = [*by_sequence.items(), overall]
        for sequence, errors in every:
            count = len(truths) if sequence is None else frames[sequence]
            groups = {group: for_json(asdict(errors.of(group))) for group in GROUPS}
            named = shared["truth"] if sequence == "" else sequence  # KITTI has one, without name
            own = {"pass_name": pass_name, "sequence": named, "frames": count}
            entries.append(Entry(**shared, **own, errors=groups))
    return Scores(entries=tuple(entries))


def _answers_of(
    flow: str | Path | Method, truths: clips.Truths, png_scale: float
) -> tuple[str, Mapping[str, Answers]]:
    """Return the name of the flow's source, and the flow of all frames by pass."""
    if isinstance(flow, str | Path) and (folder := Path(flow)).is_dir():
        return folder.resolve().name, {
            name: {
                frame: (str(path), partial(read_flow, path, png_scale=png_scale))
                for frame, path in paths.items()
            }
            for name, paths in clips.submitted_flows(folder, truths).items()
        }
    try:
        detector = method(str(flow) if isinstance(flow, Path) else flow)
    except ValueError as problem:
        raise UserError(f"{flow}: no such folder; {problem}") from None
    if not isinstance(detector, DenseDetector):
        raise UserError(f"{detector.name} gives no dense flow; give a method that does")
    pairs = ((name, each.items()) for name, each in clips.pictures_of(truths).items())

    def between(*pair: Path) -> NDArray[Any]:
        return detector.dense(*(read_codes(path, "L") for path in pair))

    return detector.name, {
        name: {frame: (str(each[0]), partial(between, *each)) for frame, each in found}
        for name, found in pairs
    }


def _scored(
    passes: Mapping[str, Answers], truths: clips.Truths, advance: Callable[[int], object]
) -> tuple[dict[str, dict[str, DenseErrors]], str]:
    """Errors by pass and sequence, and a hash of the truth; each frame of it is read once."""
    found: dict[str, dict[str, DenseErrors]] = {name: {} for name in sorted(passes)}
    hashes = []
    for frame, paths in sorted(truths.items()):
        true, occluded = clips.read_true_flow(paths)
        hashes += ["/".join(frame), *(file_hash(path) for path in paths.files())]
        hashes += [str(paths.png_scale)] * (paths.png_scale != KITTI_SCALE)
        for name, errors in found.items():
            where, answer = passes[name][frame]
            try:
                flow = answer()
                known = clips.at_pixels(paths, true, occluded, flow.shape)
                errors.setdefault(frame.sequence, DenseErrors()).add(flow, *known)
            except ValueError as problem:
                text = str(problem)
                raise UserError(text if where in text else f"{where}: {text}") from None
        advance(1)
    return found, digest(*hashes)


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
    """Read the entries of a leaderboard; none without a file. Raises UserError."""
    entries = []
    with bounded.undamaged(path, "give a leaderboard"):
        for line in bounded.read_text(path).splitlines() if os.path.lexists(path) else []:
            values = bounded.from_json(line)
            check_format("scores", values, path)
            entries.append(Entry.model_validate(values))
    return tuple(entries)


def add_entries(path: Path, entries: Iterable[Entry]) -> tuple[Entry, ...]:
    """Add entries to those of the file; return all.

    Raises UserError if the file is something else, or has other scores of the same program.
    """

    def key(entry: Entry) -> tuple[str, str, str]:
        return entry.program, entry.pass_name, entry.truth_hash

    with locked(path.parent):
        kept = {key(each): each for each in read_board(path)}
        for entry in entries:
            former = kept.setdefault(key(entry), entry)
            if former.errors != entry.errors:
                raise UserError(
                    f"{path} has other scores of {entry.program!r} for this truth; give another "
                    "--program, or remove that line"
                )
        found = tuple(kept.values())
        files.write_text(path, "".join(f"{each.model_dump_json()}\n" for each in found))
    return found


def score_table(scores: Scores) -> Table:
    """Return the errors of every sequence and overall, a block per pass."""
    title = "Endpoint error of pixels: all, and those that move 0–10, 10–40, 40+ px per frame"
    names = [
        (entry.pass_name, "overall" if entry.sequence is None else entry.sequence)
        for entry in scores.entries
    ]
    return _table(title, ("pass", "sequence"), names, scores.entries)


def board_table(entries: Iterable[Entry], truth_hash: str) -> Table:
    """Return the entries for one truth, the lowest EPE first, by pass."""

    def order(entry: Entry) -> tuple[str, float]:
        error_px = entry.errors["all"]["epe_px"]
        return entry.pass_name, math.inf if error_px is None else error_px

    shown = sorted((entry for entry in entries if entry.truth_hash == truth_hash), key=order)
    names = [(entry.pass_name, entry.program) for entry in shown]
    return _table("Leaderboard", ("pass", "program"), names, shown)


def _table(
    title: str, heads: Iterable[str], names: Iterable[tuple[str, str]], entries: Iterable[Entry]
) -> Table:
    """Return a row of errors per entry; a name "overall" ends a block."""
    table = Table(title=title, box=SIMPLE, padding=(0, 1))
    for head in heads:
        table.add_column(head, no_wrap=True)
    for head in _COLUMNS:
        table.add_column(head, justify="right", no_wrap=True)
    for pair, entry in zip(names, entries, strict=True):
        values = (entry.errors[group][field] for group, field in _COLUMNS.values())
        cells = ("–" if value is None else f"{value:.3g}" for value in values)
        is_last = pair[1] == "overall"
        style = "bold" if is_last else None
        table.add_row(*map(sentence, pair), *cells, style=style, end_section=is_last)
    return table
