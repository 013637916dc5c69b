"""Errors of velocity methods on whole frames by photons per pixel, with intervals.

Every pixel with known flow is scored (`flow.metrics.endpoint_error`); one without flow counts as
zero motion. A method's value is the mean over draws and pairs; its interval is over sequences.

**Without truth** there are two stand-ins. One is the flow by a method, the reference, between the
pictures without photon noise, which favors it and similar methods. The other is the median of all
other methods on the same photons, which may share an error.
"""

import math
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence, Sized
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from itertools import chain, islice, pairwise, product
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from megalopta.benchmark import table
from megalopta.benchmark.clips import FlowClip, luminance
from megalopta.benchmark.curves import LEGEND, METRICS as METRICS_OF_CHARTS, error_chart
from megalopta.benchmark.disturbances import Disturbance
from megalopta.benchmark.methods import block_detector, check_gives_flow
from megalopta.core.arrays import Floats
from megalopta.core.bounded import check_decoded
from megalopta.core.errors import UserError
from megalopta.core.files import write_text
from megalopta.core.pictures import SENSED_BYTES
from megalopta.core.progress import progress, say, step, working
from megalopta.core.quantities import number, with_error
from megalopta.flow.detectors.base import Frames
from megalopta.flow.detectors.blocks import BlockDetector
from megalopta.flow.detectors.registry import Method
from megalopta.flow.metrics.endpoint_error import DenseErrors
from megalopta.render import Footage, open_footage
from megalopta.report import sections
from megalopta.scenes.stimuli.pictures import Unit

PHOTONS_PER_PX: tuple[float, ...] = (1.0, 3.0, 10.0, 30.0, 100.0, 1000.0)
SECONDS, FOREGROUND = "cpu_s", "fl_foreground_share"
METRICS: Mapping[str, tuple[str, str, str]] = {
    table.MEDIAN: ("median px", "", ""),
    table.MEAN: ("mean px", "all", "epe_px"),
    "share_beyond_1_px": ("> 1 px %", "all", "over_1px_percent"),
    table.FAR: ("> 3 px %", "all", "over_3px_percent"),
    "share_beyond_5_px": ("> 5 px %", "all", "over_5px_percent"),
    "fl_share": ("Fl %", "all", "fl_percent"),
    "wauc_share": ("WAUC %", "all", "wauc_percent"),
    "mean_epe_below_10_px": ("0–10 px", "slow", "epe_px"),
    "mean_epe_10_to_40_px": ("10–40 px", "medium", "epe_px"),
    "mean_epe_from_40_px": ("40+ px", "fast", "epe_px"),
    "mean_epe_visible_px": ("visible", "visible", "epe_px"),
    "mean_epe_occluded_px": ("occluded", "occluded", "epe_px"),
    FOREGROUND: ("Fl-fg %", "", ""),
    table.NONE: ("none %", "", ""),
    SECONDS: ("CPU s", "", ""),
}
"""Head of its column, group of pixels and field of `endpoint_error.DenseError` by metric"""
FROM_OTHERS = "mean_px_from_others"
"""Mean distance from the median of the flow of all other methods, where nobody knows the truth"""

UNDISTURBED = "none"
_CASE = ["set", "unit", "group", "photons", "method", "frames"]

_Frame: TypeAlias = tuple[Footage, int]
"""Where a picture is read when needed"""


@dataclass(frozen=True, eq=False)
class Board:
    """Errors of methods over the pixels of pairs, by photons per pixel and frame."""

    by_draw: pd.DataFrame
    """A column per metric, NaN if unknown.

    A row per set, sequence, pair (unit), disturbance (group), photons, method and its number of
    frames, and draw."""
    against: str = ""
    """Method from which `means` have differences; default: the best"""

    def parts(self) -> Mapping[str | None, str]:
        """Return the headings of all pairs together (None) and, if there are several, of sets."""
        pairs = self.by_draw[["set", "unit"]].drop_duplicates()
        heads = {None: f"All {len(pairs)} pairs" if len(pairs) > 1 else str(pairs["unit"].iloc[0])}
        counts = pairs["set"].value_counts(sort=False).items()
        sets = {str(name): f"{name} ({count} pairs)" for name, count in counts}
        return heads | (sets if len(sets) > 1 else {})

    def samples(self, set_name: str | None, flux: float) -> pd.DataFrame:
        """Return the values of a set, or of all, at a flux, as `table.samples`.

        Frames of one sequence are alike, so units are sequences; of one sequence, its pairs, and
        of one pair, its draws.
        """
        rows = self.by_draw[self.by_draw["photons"] == flux]
        if set_name is not None:
            rows = rows[rows["set"] == set_name]
        rows = rows.assign(unit=rows[self.units(set_name)[0]])
        values = rows.melt([*_CASE, "sequence", "draw"], var_name="metric", value_name="total")
        of_unit = values.dropna().groupby([*table.CASE, "unit"], sort=False)["total"]
        return of_unit.agg(total="sum", blocks="count").astype(float).reset_index()

    def units(self, set_name: str | None) -> tuple[str, str]:
        """Return the column of `by_draw` that tells units apart, and what their low and high are.

        Of fewer than five units, or pairs of one sequence, these are the extremes.
        """
        rows = self.by_draw
        rows = rows if set_name is None else rows[rows["set"] == set_name]
        plurals = {"sequence": "sequences", "unit": "pairs of one sequence", "draw": "draws"}
        for column, plural in plurals.items():
            if (count := rows[column].nunique()) > 1:
                is_few = column == "unit" or count < table.FEWEST_UNITS
                return column, f"{'range of' if is_few else '95 % CI over'} {count} {plural}"
        return "draw", ""

    def means(self, set_name: str | None, flux: float) -> pd.DataFrame:
        """Return `table.means` of a set, with low and high as `units` says, at a flux."""
        samples = self.samples(set_name, flux)
        rows = table.means(samples, against=self.against).set_index(table.CASE)
        if "range" in self.units(set_name)[1]:
            values = samples.assign(value=samples["total"] / samples["blocks"])
            ends = values.groupby(table.CASE)["value"]
            rows["low"], rows["high"], rows["difference_half"] = ends.min(), ends.max(), math.nan
        return rows.reset_index()


def frame_errors(
    clips: Iterable[FlowClip],
    methods: Sequence[Method],
    fluxes: Sequence[float] = PHOTONS_PER_PX,
    draws: int = 1,
    disturbances: Sequence[Disturbance] = (),
    count: int = 0,
    against: str = "",
) -> Board:
    """Return the errors of methods on the same photons of all clips, means per pixel and frame.

    One clip is in memory at a time; `count` is their number, if an iterator gives them. Three or
    more methods are also compared with each other. Raises ValueError if a method gives no velocity,
    or no flow anywhere, or needs more frames than a clip has, or a clip is too small.
    """
    detectors = [block_detector(method) for method in methods]
    count = len(clips) if isinstance(clips, Sized) else count
    cases = list(product(range(draws), (None, *disturbances), fluxes))
    rows, clips = list[dict[str, Any]](), iter(clips)
    with step("benchmark pairs"), working("Compiling and trying the methods"):
        for first in (first_clips := list(islice(clips, 1))):  # before time is measured
            brightest = first.counts(max(fluxes), 0)
            for detector in detectors:
                check_gives_flow(detector, dense_flow(detector, first, brightest))
    with progress("Measuring flow", count * len(cases), "draw") as advance:
        for clip in chain(first_clips, clips):
            for draw, disturbance, flux in cases:
                counts = clip.counts(flux, draw, disturbance)
                case = {"set": clip.set_name, "unit": clip.name, "photons": flux, "draw": draw}
                case["sequence"] = clip.sequence or f"{clip.set_name} {clip.name}".strip()
                case["group"] = str(disturbance or UNDISTURBED)
                rows += [case | errors for errors in _errors(detectors, clip, counts)]
                advance()
    if not rows:
        raise ValueError("no pair with texture; give others")
    return Board(pd.DataFrame(rows), against)


def _errors(
    detectors: Sequence[BlockDetector], clip: FlowClip, counts: Frames
) -> list[dict[str, Any]]:
    """Return method and values of the metrics that are known."""
    known, flows, rows = np.isfinite(clip.flow).all(axis=-1), list[NDArray[np.float32]](), []
    for detector in detectors:
        start = time.process_time()
        flow = dense_flow(detector, clip, counts)
        row: dict[str, Any] = {SECONDS: time.process_time() - start}
        row |= {"method": detector.name, "frames": detector.memory_frames + 1}
        is_missing = np.asarray(~np.isfinite(flow).all(axis=-1))
        row[table.NONE], flow[is_missing] = is_missing[known].mean(), 0
        row[table.MEDIAN] = np.median(np.hypot(*(flow - clip.flow)[known].T))
        errors = DenseErrors()
        errors.add(flow, clip.flow, clip.hidden)
        for metric, (_, group, field) in METRICS.items():
            if group and (group != "visible" or clip.hidden is not None):
                scale = 0.01 if field.endswith("percent") else 1
                row[metric] = scale * asdict(errors.of(group))[field]
        if clip.foreground is not None:
            objects = DenseErrors()
            objects.add(flow, np.where(clip.foreground[..., np.newaxis], clip.flow, np.nan))
            row[FOREGROUND] = 0.01 * objects.of("all").fl_percent
        flows.append(flow.astype(np.float32))
        rows.append(row)
    for place, row in enumerate(rows if len(rows) > 2 else ()):
        consensus = np.median(flows[:place] + flows[place + 1 :], axis=0)
        row[FROM_OTHERS] = np.hypot(*(flows[place] - consensus)[known].T).mean()
    return rows


def write_board(path: Path, board: Board, stand_in: str = "") -> None:
    """Write a row per pair, draw, disturbance, flux and method, as CSV, and charts as NAME.html.

    Without truth, rows name the stand-in, and there are no charts; else NAME-means.csv has the
    means over pairs, with low and high, and what these are (`Board.units`).
    """
    columns = ["sequence", "draw", *_CASE, *METRICS, *([FROM_OTHERS] if stand_in else [])]
    rows = board.by_draw.reindex(columns=columns)
    names = {"unit": "pair", "group": "disturbance", "photons": "photons_per_px"}
    if not stand_in:
        cases = product(board.parts(), board.by_draw["photons"].unique())
        means = pd.concat(
            board.means(name, flux).assign(set=name or "all", ends=board.units(name)[1])
            for name, flux in cases
        )
        _write_charts(path.with_suffix(".html"), board, means[means["group"] == UNDISTURBED])
        text = means.rename(columns=names).to_csv(index=False, float_format="%.6g", na_rep="nan")
        write_text(path.with_stem(f"{path.stem}-means"), text)
    else:
        distances = {name: name.replace("epe_", "") for name in METRICS if name != SECONDS}
        names |= {name: f"{distance}_from_stand_in" for name, distance in distances.items()}
        rows.insert(8, "stand_in", stand_in)
    rows = rows.rename(columns=names)
    write_text(path, rows.to_csv(index=False, float_format="%.6g", na_rep="nan"))


def _write_charts(path: Path, board: Board, means: pd.DataFrame) -> None:
    parts = []
    for set_name, head in board.parts().items():
        rows = means[means["set"] == (set_name or "all")]
        title = ", ".join(filter(None, (head, board.units(set_name)[1])))
        errors = rows[rows["metric"] == table.MEAN].sort_values("value")
        lines = [
            (
                row.method,
                f"{row.photons:g}",
                f"{number(row.value)} ({number(row.low)} to {number(row.high)})",
                with_error(row.difference, row.difference_half, ""),
                row.against,
            )
            for row in table.records(errors.sort_values("photons", kind="stable"))
        ]
        heads = "method", "photons per px", "mean px", "difference, px", "from"
        charts = (
            error_chart(of_metric, str(metric), ("photons per pixel", "", 1), title, of_metric)
            for metric, of_metric in rows.groupby("metric", sort=False)
            if metric in METRICS_OF_CHARTS
        )
        parts += [sections.heading(title), sections.table(title, heads, lines)]
        parts.append(sections.block("pair", *charts))
    text = f"Of all pixels with known flow; ± of differences: 95 % CI, paired. {LEGEND}"
    page = [sections.Section("Errors", text, body=sections.block("", *parts))]
    sections.write_sections(path, "Flow methods on pairs of pictures", "", page)


def dense_flow(detector: BlockDetector, clip: FlowClip, counts: Frames) -> Floats:
    """Return the flow (H, W, 2) in the middle of counts (T, H, W), px; NaN if a method has none.

    Raises ValueError if the method needs more frames.
    """
    needed = detector.memory_frames + 1
    if len(counts) < needed:
        raise ValueError(f"{clip.name} has {len(counts)} frames; {detector.name} needs {needed}")
    first = (len(counts) - needed) // 2
    return np.array(detector.dense(*counts[first : first + needed]))


def pairs_without_truth(
    stack: ExitStack, paths: Sequence[Path], unit: Unit | None = None
) -> dict[str, tuple[_Frame, _Frame]]:
    """Return two pictures, or all pairs of successive frames, by name.

    The stack closes opened files. Raises UserError if there are not two frames.
    """
    opened = [stack.enter_context(open_footage(path, unit)) for path in paths]
    for footage in opened:
        check_decoded(footage.path, footage.shape, SENSED_BYTES)
    for note in dict.fromkeys(note for footage in opened for note in footage.notes):
        say(note)
    frames = [(footage, k) for footage in opened for k in range(len(footage))]
    if len(frames) < 2 or len(opened) > 2 or (len(opened) == 2 and len(frames) > 2):
        raise UserError(
            f"benchmark pairs: {len(paths)} paths, {len(frames)} frames in all; without truth, give"
            " two pictures, a folder of pictures or a video"
        )
    if len({footage.shape for footage in opened}) > 1:
        sizes = " and ".join(f"{f.shape[1]} × {f.shape[0]}" for f in opened)
        raise UserError(f"{paths[0]} and {paths[1]} have {sizes} px; give one size")
    if len(opened) == 2:
        return {paths[0].stem: (frames[0], frames[1])}
    return {f"{paths[0].stem} {k}": pair for k, pair in enumerate(pairwise(frames))}


def clips_without_truth(
    pairs: Mapping[str, tuple[_Frame, _Frame]], reference: Method
) -> Iterator[FlowClip]:
    """Yield pairs whose true flow is replaced by that of the reference without photon noise.

    A pair without contrast, or in which the reference finds no flow, is excluded.
    """
    detector = block_detector(reference)
    for name, (first, second) in pairs.items():
        light = np.stack([luminance(*first), luminance(*second)])
        light /= light.mean() or 1
        flow = detector.dense(*light * 1000.0)  # photons per pixel
        if light.min() == light.max() or not np.isfinite(flow).any():
            say(f"{name}: no contrast, or {detector.name} finds no flow; skipping the pair")
        else:
            yield FlowClip(name, light, flow, sequence="frames")
