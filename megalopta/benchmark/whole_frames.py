"""Errors of velocity methods on whole frames by photons per pixel, with intervals.

Every pixel with known flow is scored (`flow.metrics.endpoint_error`); one without flow counts as
zero motion. A method's value is the mean over draws and pairs, with its interval over pairs.

**Without truth** there are two stand-ins. One is the flow by a method, the reference, between the
pictures without photon noise, which favors it and similar methods. The other is the median of all
other methods on the same photons, which may share an error.
"""

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence, Sized
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from itertools import pairwise, product
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from megalopta.benchmark import table
from megalopta.benchmark.clips import FlowClip, luminance
from megalopta.benchmark.disturbances import Disturbance
from megalopta.benchmark.methods import block_detector
from megalopta.benchmark.table import FAR, MEAN, MEDIAN
from megalopta.core.arrays import Floats
from megalopta.core.bounded import check_decoded
from megalopta.core.errors import UserError
from megalopta.core.files import write_text
from megalopta.core.pictures import SENSED_BYTES
from megalopta.core.progress import progress, say
from megalopta.flow.detectors.base import Frames
from megalopta.flow.detectors.blocks import BlockDetector
from megalopta.flow.detectors.registry import Method
from megalopta.flow.metrics.endpoint_error import DenseErrors
from megalopta.render import Footage, open_footage
from megalopta.scenes.stimuli.pictures import Unit

PHOTONS_PER_PX: tuple[float, ...] = (1.0, 3.0, 10.0, 30.0, 100.0, 1000.0)
SECONDS, FOREGROUND = "cpu_s", "fl_foreground_share"
METRICS: Mapping[str, tuple[str, str, str]] = {
    MEDIAN: ("median px", "", ""),
    MEAN: ("mean px", "all", "epe_px"),
    "share_beyond_1_px": ("> 1 px %", "all", "over_1px_percent"),
    FAR: ("> 3 px %", "all", "over_3px_percent"),
    "share_beyond_5_px": ("> 5 px %", "all", "over_5px_percent"),
    "fl_share": ("Fl %", "all", "fl_percent"),
    "wauc_share": ("WAUC %", "all", "wauc_percent"),
    "mean_epe_below_10_px": ("0–10", "slow", "epe_px"),
    "mean_epe_10_to_40_px": ("10–40", "medium", "epe_px"),
    "mean_epe_from_40_px": ("40+", "fast", "epe_px"),
    "mean_epe_visible_px": ("visible", "visible", "epe_px"),
    "mean_epe_occluded_px": ("occluded", "occluded", "epe_px"),
    FOREGROUND: ("Fl-fg %", "", ""),
    SECONDS: ("CPU s", "", ""),
}
"""Head of its column, group of pixels and field of `endpoint_error.DenseError` by metric"""
FROM_OTHERS = "mean_px_from_others"
"""Mean distance from the median of the flow of all other methods, where nobody knows the truth"""

OWN_METHODS = "PF", "PF-fast", "PPF", "PM", "PPM"
"""Of these, verdicts name the first that was measured, if its error is not the lowest"""
UNDISTURBED = "none"
_CASE = ["set", "unit", "group", "photons", "method", "frames"]

_CLEAN_PHOTONS = 1000.0
"""Photons per pixel of the noise-free light that the reference sees."""

_Frame: TypeAlias = tuple[Footage, int]
"""Where a picture is read when needed"""


@dataclass(frozen=True, eq=False)
class Board:
    """Errors of methods over the pixels of pairs, by photons per pixel and frame."""

    by_scene: pd.DataFrame
    """Means over draws, a column per metric, NaN if unknown.

    A row per set, pair (unit), disturbance (group), photons, method and its number of frames."""

    def parts(self) -> Mapping[str | None, str]:
        """Return the headings of all pairs together (None) and, if there are several, of sets."""
        pairs = self.by_scene[["set", "unit"]].drop_duplicates()
        heads = {None: f"All {len(pairs)} pairs" if len(pairs) > 1 else str(pairs["unit"].iloc[0])}
        counts = pairs["set"].value_counts(sort=False).items()
        sets = {str(name): f"{name} ({count} pairs)" for name, count in counts}
        return heads | (sets if len(sets) > 1 else {})

    def samples(self, set_name: str | None, flux: float) -> pd.DataFrame:
        """Return the values of the pairs of a set, or of all, at a flux, as `table.samples`."""
        rows = self.by_scene[self.by_scene["photons"] == flux]
        if set_name is not None:
            rows = rows[rows["set"] == set_name]
        return rows.melt(_CASE, var_name="metric", value_name="total").dropna().assign(blocks=1.0)


def verdicts(board: Board) -> Iterator[str]:
    """Yield which methods are first, by how much: a sentence per set, disturbance and photons.

    All pairs together come first. The difference to the next method, and to the first of
    `OWN_METHODS`, has Student's 95 % interval over pairs.
    """
    if board.by_scene["method"].nunique() < 2:
        return
    groups, fluxes = (board.by_scene[name].unique() for name in ("group", "photons"))
    for group, (set_name, pairs), flux in product(groups, board.parts().items(), fluxes):
        rows = board.samples(set_name, flux).query("group == @group")
        px = rows.pivot(index=["set", "unit"], columns=["metric", "method"], values="total")
        mean, median = (_lead(px[[name]].droplevel(0, axis=1)) for name in (MEAN, MEDIAN))
        disturbed = "" if group == UNDISTURBED else f", {group}"
        yield f"{pairs}{disturbed}, {flux:g} photons: lowest mean {mean}; lowest median {median}"


def _lead(px: pd.DataFrame) -> str:
    """Return the method of the least mean, and how far the next and our own are above it."""
    first, second, *_ = px.mean().sort_values(kind="stable").index
    own, above = next((name for name in OWN_METHODS if name in px), first), []
    for name in dict.fromkeys((second, own) if own != first else (second,)):
        gap, half = table.difference(px[name].to_numpy(), px[first].to_numpy())
        above.append(f"{name} {gap:.2f}{f' ± {half:.2f}' if half == half else ''} px")
    return f"{first} {px[first].mean():.2f} px, {' and '.join(above)} above it"


def frame_errors(
    clips: Iterable[FlowClip],
    methods: Sequence[Method],
    fluxes: Sequence[float] = PHOTONS_PER_PX,
    draws: int = 1,
    disturbances: Sequence[Disturbance] = (),
    count: int = 0,
) -> Board:
    """Return the errors of methods on the same photons of all clips, means per pixel and frame.

    One clip is in memory at a time; `count` is their number, if an iterator gives them. Three or
    more methods are also compared with each other. Raises ValueError if a method gives no velocity
    or needs more frames than a clip has, or a clip is too small.
    """
    detectors = [block_detector(method) for method in methods]
    count = len(clips) if isinstance(clips, Sized) else count
    cases = list(product(range(draws), (None, *disturbances), fluxes))
    rows = list[dict[str, Any]]()
    with progress("Measuring flow", count * len(cases), "draw") as advance:
        for clip in clips:
            for draw, disturbance, flux in cases:
                counts = clip.counts(flux, draw, disturbance)
                if not rows:  # compiled before time is measured
                    for detector in detectors:
                        dense_flow(detector, clip, counts)
                case = {"set": clip.set_name, "unit": clip.name, "photons": flux}
                case["group"] = str(disturbance or UNDISTURBED)
                rows += [case | errors for errors in _errors(detectors, clip, counts)]
                advance()
    if not rows:
        raise ValueError("no pair with texture; give others")
    return Board(pd.DataFrame(rows).groupby(_CASE, sort=False, as_index=False).mean())


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
        row[MEDIAN] = np.median(np.hypot(*(flow - clip.flow)[known].T))
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
    """Write a row per pair, disturbance, flux and method, as CSV: means over the pair's draws.

    Without truth, rows name the stand-in.
    """
    columns = [*_CASE, *METRICS, *([FROM_OTHERS] if stand_in else [])]
    rows = board.by_scene.reindex(columns=columns)
    names = {"unit": "pair", "group": "disturbance", "photons": "photons_per_px"}
    if stand_in:
        distances = {name: name.replace("epe_", "") for name in METRICS if name != SECONDS}
        names |= {name: f"{distance}_from_stand_in" for name, distance in distances.items()}
        rows.insert(6, "stand_in", stand_in)
    rows = rows.rename(columns=names)
    write_text(path, rows.to_csv(index=False, float_format="%.6g", na_rep="nan"))


def dense_flow(detector: BlockDetector, clip: FlowClip, counts: Frames) -> Floats:
    """Return the flow (H, W, 2) in the middle of counts (T, H, W), px; 0 if a method gives none.

    Raises ValueError if the method needs more frames.
    """
    needed = detector.memory_frames + 1
    if len(counts) < needed:
        raise ValueError(f"{clip.name} has {len(counts)} frames; {detector.name} needs {needed}")
    first = (len(counts) - needed) // 2
    flow = detector.dense(*counts[first : first + needed])
    return np.nan_to_num(flow, nan=0.0, posinf=0.0, neginf=0.0)


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
        flow = detector.dense(*light * _CLEAN_PHOTONS)
        if light.min() == light.max() or not np.isfinite(flow).any():
            say(f"{name}: no contrast, or {detector.name} finds no flow; skipping the pair")
        else:
            yield FlowClip(name, light, flow)
