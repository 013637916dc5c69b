"""Scores of flow files, or of a method's flow: by sequence and overall, for every pass."""

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import FiniteFloat, NonNegativeInt, PositiveInt
from rich.box import SIMPLE
from rich.table import Table

from megalopta.benchmark import clips
from megalopta.benchmark.seal import opened_seal
from megalopta.benchmark.whole_frames import METRICS
from megalopta.core.bounded import sentence
from megalopta.core.errors import UserError
from megalopta.core.format_numbers import FORMATS
from megalopta.core.freshness import digest
from megalopta.core.pictures import read_codes
from megalopta.core.progress import progress
from megalopta.core.record import Record
from megalopta.dataset.store import file_hash
from megalopta.flow.detectors.blocks import BlockDetector
from megalopta.flow.detectors.poisson_flow import PoissonFlow
from megalopta.flow.detectors.registry import Method, method
from megalopta.flow.formats import KITTI_SCALE, read_flow, read_uncertainty
from megalopta.flow.likelihood.alignment import round_trip
from megalopta.flow.metrics.endpoint_error import GROUPS, DenseErrors, sparsified
from megalopta.flow.metrics.response_error import for_json

FlowAndUncertainty = tuple[NDArray[Any], NDArray[Any] | None]
"""(H, W, 2) and, if known, (H, W), px"""
Flows = Mapping[clips.FrameName, tuple[str, Callable[[], FlowAndUncertainty]]]
"""Source of a frame's flow, and a function that returns it"""


class Entry(Record, frozen=True):
    """A row of the table of scores: a program's flow over one pass, of all or of one sequence."""

    format: NonNegativeInt = FORMATS["scores"].written
    """Format of this row (`format_numbers`)"""
    program: str
    pass_name: str
    """Sintel's "clean" or "final"; empty without passes"""
    sequence: str | None = None
    """None: over all sequences"""
    truth: str
    """Name of the folder of the true flow"""
    truth_hash: str
    """Hash of the true flow; only entries with the same one are comparable"""
    frames: PositiveInt
    errors: Mapping[str, Mapping[str, int | FiniteFloat | None]]
    """Fields of `DenseError` by group of pixels (`GROUPS`), and of `SparsifiedError` as
    "confidence"; None if it has no pixel, or is unknown"""


class Scores(Record, frozen=True):
    """The table: for each pass an entry per sequence, then one over all."""

    format: NonNegativeInt = FORMATS["scores"].written
    """Format of this file (`format_numbers`)"""
    entries: tuple[Entry, ...]


def score_submissions(
    flows: Sequence[str | Path | Method],
    truth: Path,
    program: str | None = None,
    png_scale: float = KITTI_SCALE,
    inputs: Path | None = None,
) -> Scores:
    """Score flow against the true flow of a dataset, or of Sintel, KITTI, Spring and others.

    Raises UserError if frames have no file or files no frame, a file is damaged or of another
    size, a method gives no dense flow, two programs have one name, or a sealed truth was changed.

    Parameters
    ----------
    flows
        Folders of `.flo`, `.flo5`, `.pfm`, `.npy` or KITTI's PNG files (px per frame), laid out as
        the truth; `NAME.uncertainty.npy` has the expected error of `NAME.flo`, if stated. Or
        methods to run on the truth's own frames: a name, `module:function`, ONNX file, or a
        function from Python.
    truth
        Folder of the true flow.
    program
        Name of the program that wrote the flow; default: that of its folder, or of the method.
    png_scale
        Codes of a pixel in flow as PNG, true or not: 64 in KITTI, 128 in DSEC.
    inputs
        Published inputs of a sealed truth (`benchmark.seal`); default: `inputs` next to it.
    """
    if not truth.is_dir():
        raise UserError(f"{truth}: no such folder")
    sealed = opened_seal(truth, inputs)
    truths = clips.true_flows(truth, png_scale)
    name_of_truth, hashes = truth.resolve().name, []
    submissions = [
        (program or name, pass_name, flow_of, defaultdict[str, DenseErrors](DenseErrors))
        for name, passes in [_flows_of(flow, truths, png_scale) for flow in flows]
        for pass_name, flow_of in sorted(passes.items())
    ]
    names = Counter((name, pass_name) for name, pass_name, *_ in submissions)
    (name, _), number = names.most_common(1)[0]
    if number > 1:
        raise UserError(f"{name}: {number} programs of this name; rename the folders")
    with progress("Scoring flow", len(truths), "frame") as advance:
        for frame, paths in sorted(truths.items()):
            true, occluded = clips.read_true_flow(paths)
            hashes += ["/".join(frame), *(file_hash(path) for path in paths.files())]
            hashes += [str(paths.png_scale)] * (paths.png_scale != KITTI_SCALE)
            for *_, flow_of, errors in submissions:
                source, read = flow_of[frame]
                try:
                    estimate, uncertainty = read()
                    known = clips.at_pixels(paths, true, occluded, estimate.shape)
                    errors[frame.sequence].add(estimate, *known, uncertainty)
                except ValueError as problem:
                    text = str(problem)
                    raise UserError(text if source in text else f"{source}: {text}") from None
            advance(1)
    frames, entries = Counter(frame.sequence for frame in truths), []
    for name, pass_name, _, errors in submissions:
        overall = None, len(truths), DenseErrors.joined(errors.values())
        by_sequence = ((key or name_of_truth, frames[key], part) for key, part in errors.items())
        for sequence, count, part in (*by_sequence, overall):  # that of KITTI has no name
            by_group = {group: for_json(asdict(part.of(group))) for group in GROUPS}
            confidence = for_json(sparsified(part.sparsification)._asdict())
            entry = Entry(
                program=name,
                pass_name=pass_name,
                sequence=sequence,
                truth=name_of_truth,
                truth_hash=sealed or digest(*hashes),  # a plain one would confirm guesses
                frames=count,
                errors={**by_group, "confidence": confidence},
            )
            entries.append(entry)
    return Scores(entries=tuple(entries))


def _flows_of(
    flow: str | Path | Method, truths: clips.Truths, png_scale: float
) -> tuple[str, Mapping[str, Flows]]:
    """Return the name of the flow's source, and the flow of all frames by pass."""
    if isinstance(flow, str | Path) and (folder := Path(flow)).is_dir():
        flows: dict[str, Flows] = {}
        for name, paths in clips.submitted_flows(folder, truths).items():
            stated = any(clips.uncertainty_of(path).exists() for path in paths.values())
            read = partial(_read, png_scale=png_scale, stated=stated)
            flows[name] = {frame: (str(path), partial(read, path)) for frame, path in paths.items()}
        return folder.resolve().name, flows
    try:
        detector = method(str(flow) if isinstance(flow, Path) else flow)
    except ValueError as problem:
        missing = "" if ":" in str(flow) else f"{flow}: no such folder; "
        raise UserError(f"{missing}{problem}") from None
    if not isinstance(detector, BlockDetector) or type(detector).dense is BlockDetector.dense:
        raise UserError(f"{detector.name} gives no dense flow; give a method that does")

    def between(*pair: Path) -> FlowAndUncertainty:
        first, second = (read_codes(path, "L") for path in pair)
        if isinstance(detector, PoissonFlow):
            estimate, covariance = detector.dense_with_covariance(first, second)
            return estimate, np.sqrt(np.trace(covariance, axis1=-2, axis2=-1))
        forth, back = detector.dense(first, second), detector.dense(second, first)
        return forth, round_trip(np.moveaxis(forth, -1, 0), np.moveaxis(back, -1, 0))

    source = f"{detector.name} on {{}}".format
    return detector.name, {
        name: {frame: (source(pair[0]), partial(between, *pair)) for frame, pair in pairs.items()}
        for name, pairs in clips.pictures_of(truths).items()
    }


def _read(path: Path, png_scale: float, stated: bool) -> FlowAndUncertainty:
    """Return the flow of a file and its uncertainty, infinite where only others have a file."""
    flow, place = read_flow(path, png_scale=png_scale), clips.uncertainty_of(path)
    if stated and place.exists():
        return flow, read_uncertainty(place, flow.shape[:2])
    return flow, np.full(flow.shape[:2], np.inf) if stated else None


_COLUMNS: Mapping[str, tuple[str, str]] = {
    **{head: (group, field) for head, group, field in METRICS.values() if group},
    "angle °": ("all", "angular_deg"),
    "none %": ("all", "missing_percent"),
    "sure ½": ("confidence", "surest_half_px"),
    "AUSE": ("confidence", "ause"),
    "random": ("confidence", "ause_random"),
}


def score_table(scores: Scores) -> Table:
    """Return the errors of every sequence and overall, a block per pass; columns that are known."""
    title = "Endpoint error of pixels: all, and those that move 0–10, 10–40, 40+ px per frame"
    table = Table(title=title, box=SIMPLE, padding=(0, 1))
    for head in ("program", "pass", "sequence"):
        table.add_column(head, no_wrap=True)
    columns = {}
    for head, (group, field) in _COLUMNS.items():
        if any(entry.errors[group][field] is not None for entry in scores.entries):
            columns[head] = group, field
            table.add_column(head, justify="right", no_wrap=True)
    for entry in scores.entries:
        style = "bold" if entry.sequence is None else None
        names = map(sentence, (entry.program, entry.pass_name, entry.sequence or "overall"))
        values = (entry.errors[group][field] for group, field in columns.values())
        cells = ("–" if value is None else f"{value:.3g}" for value in values)
        table.add_row(*names, *cells, style=style, end_section=bool(style))
    return table
