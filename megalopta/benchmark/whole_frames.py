"""Errors of velocity methods on whole frames by photons per pixel, with intervals.

Every pixel with known flow is scored (`flow.metrics.endpoint_error`). Methods of blocks have blocks
of 24 × 24 px, between which their velocities are interpolated. A pixel without flow counts as zero
motion. Next to the median there are the mean, shares of pixels that are far off, Fl and WAUC, and
means by speed and by occlusion. A method's value is the mean over draws and pairs, with its
interval over pairs (`table`).

**Without truth** there are two stand-ins. One is the flow by a method, the reference, between the
pictures without photon noise, which favors it and similar methods. The other is the median of all
other methods on the same photons, which may share an error.
"""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Sized
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from functools import partial
from itertools import pairwise, product
from pathlib import Path
from types import MappingProxyType
from typing import TypeAlias

import numpy as np
import pandas as pd

from megalopta.benchmark import table
from megalopta.benchmark.clips import FlowClip
from megalopta.benchmark.disturbances import Disturbance
from megalopta.benchmark.methods import block_detector, methods_and_baselines
from megalopta.benchmark.table import FAR, FAR_PX, MEAN, MEDIAN
from megalopta.core.arrays import Floats
from megalopta.core.bounded import check_decoded
from megalopta.core.errors import UserError, refused_as
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
SECONDS = "cpu_s"
_DENSE: Mapping[str, tuple[str, str]] = {
    "share_beyond_1_px": ("all", "over_1px_percent"),
    "share_beyond_5_px": ("all", "over_5px_percent"),
    "fl_share": ("all", "fl_percent"),
    "wauc_share": ("all", "wauc_percent"),
    "mean_epe_below_10_px": ("slow", "epe_px"),
    "mean_epe_10_to_40_px": ("medium", "epe_px"),
    "mean_epe_from_40_px": ("fast", "epe_px"),
    "mean_epe_visible_px": ("visible", "epe_px"),
    "mean_epe_occluded_px": ("occluded", "epe_px"),
}
"""Group of pixels and field of `endpoint_error.DenseError` by metric; speeds are px per frame"""
METRICS: Mapping[str, str] = MappingProxyType(
    {
        MEDIAN: "median px",
        MEAN: "mean px",
        "share_beyond_1_px": "> 1 px %",
        FAR: "> 3 px %",
        "share_beyond_5_px": "> 5 px %",
        "fl_share": "Fl %",
        "wauc_share": "WAUC %",
        "mean_epe_below_10_px": "0–10",
        "mean_epe_10_to_40_px": "10–40",
        "mean_epe_from_40_px": "40+",
        "mean_epe_visible_px": "visible",
        "mean_epe_occluded_px": "occluded",
        SECONDS: "CPU s",
    }
)
"""Heads of columns by metric"""
FROM_STAND_IN, FROM_OTHERS = (
    {MEDIAN: f"median_px_{of}", MEAN: f"mean_px_{of}", FAR: f"{FAR}_{of}"}
    for of in ("from_stand_in", "from_others")
)
"""Metrics against the flow of the reference, and against the median of the other methods, by the
corresponding metric of an error."""

OWN_METHODS = "PM", "PPM", "PF", "PPF", "PF-fast"
"""Methods of this program for photon counts, which a verdict names where they are not first"""
UNDISTURBED = "none"

_CLEAN_PHOTONS = 1000.0
"""Photons per pixel of the noise-free light that the reference sees."""

Measures: TypeAlias = Iterator[tuple[str, str, float]]
"""Metric, method and value; NaN is unknown"""

_Light: TypeAlias = Callable[[], Floats]
"""Returns the luminance (H, W) of a picture when needed."""


@dataclass(frozen=True, eq=False)
class Board:
    """Errors of methods over the pixels of pairs, by photons per pixel and frame."""

    detectors: Sequence[BlockDetector]
    samples: pd.DataFrame
    """A row per set, metric, method, photons, disturbance (group) and pair (`table.samples`): the
    sum over known draws, and their number (blocks)"""

    def parts(self) -> Mapping[str | None, str]:
        """Return the headings of all pairs together (None) and, if there are several, of sets."""
        pairs = self.samples.groupby("set", sort=False)["unit"].nunique()
        count = int(pairs.sum())
        whole = {None: f"All {count} pairs" if count > 1 else str(self.samples["unit"].iloc[0])}
        sets = {str(name): f"{name} ({number} pairs)" for name, number in pairs.items()}
        return whole | (sets if len(sets) > 1 else {})

    def of(self, set_name: str | None, group: str = UNDISTURBED) -> pd.DataFrame:
        """Return the samples of a set, or of all, with a disturbance or without."""
        samples = self.samples[self.samples["group"] == group]
        return samples if set_name is None else samples[samples["set"] == set_name]

    def by_scene(self) -> pd.DataFrame:
        """Return the mean over draws, a column per metric.

        A row per set, pair, disturbance, photons and method.
        """
        rows = self.samples.assign(value=self.samples["total"] / self.samples["blocks"])
        names = ["set", "unit", "group", "photons", "method"]
        wide = rows.pivot(index=names, columns="metric", values="value")
        return wide.reindex(pd.MultiIndex.from_frame(rows[names].drop_duplicates()))


def verdicts(board: Board) -> Iterator[str]:
    """Yield which methods are first, by how much: a sentence per set, disturbance and photons.

    All pairs together come first. The difference to the next method, and to the first of
    `OWN_METHODS` if none of the two is among them, has Student's 95 % interval over pairs.
    """
    if len(board.detectors) < 2:
        return
    for group, (set_name, pairs) in product(board.samples["group"].unique(), board.parts().items()):
        disturbed = "" if group == UNDISTURBED else f", {group}"
        for flux, rows in board.of(set_name, group).groupby("photons", sort=False):
            mean, median = (_lead(rows[rows["metric"] == name]) for name in (MEAN, MEDIAN))
            where = f"{pairs}{disturbed}, {flux:g} photons"
            yield f"{where}: lowest mean {mean}; lowest median {median}"


def _lead(rows: pd.DataFrame) -> str:
    """Return the method of the least mean, and how far the next and our own first are above it."""
    sums = table.by_method(rows)
    mean_px = {name: table.mean(errors) for name, errors in sums.items()}
    first, *others = sorted(mean_px, key=lambda name: mean_px[name])
    own = [name for name in (first, *others) if name in OWN_METHODS]
    above = []
    for name in dict.fromkeys((others[0], *own[: first not in OWN_METHODS])):
        gap = table.difference(sums[name], sums[first])
        interval = f" ± {gap.high - gap.value:.2f}" if gap.high == gap.high else ""
        above.append(f"{name} {gap.value:.2f}{interval} px")
    return f"{first} {mean_px[first]:.2f} px, {' and '.join(above)} above it"


def frame_errors(
    clips: Iterable[FlowClip],
    methods: Sequence[Method],
    fluxes: Sequence[float] = PHOTONS_PER_PX,
    draws: int = 1,
    disturbances: Sequence[Disturbance] = (),
    count: int | None = None,
) -> Board:
    """Return the errors of methods on the same photons of all clips, means per pixel and frame.

    One clip is in memory at a time; `count` is their number, if an iterator gives them. Raises
    ValueError if a method gives no velocity or needs more frames than a clip has, or a clip is too
    small.
    """
    detectors = [block_detector(method) for method in methods]
    key, is_compiled = ("whole frames",), False

    def measure(clip: FlowClip, counts: Frames) -> Measures:
        nonlocal is_compiled
        if not is_compiled:  # before time is measured
            for detector in detectors:
                dense_flow(detector, clip, counts)
            is_compiled = True
        known = np.isfinite(clip.flow).all(axis=-1)
        for detector in detectors:
            start = time.process_time()
            flow = dense_flow(detector, clip, counts)
            yield SECONDS, detector.name, time.process_time() - start
            for metric, value in measures(distances(flow, clip.flow)[known]):
                yield metric, detector.name, value
            dense = DenseErrors()
            dense.add(flow, clip.flow, clip.hidden)
            for metric, (group, field) in _DENSE.items():
                value = asdict(dense.of(group))[field]
                unknown = group == "visible" and clip.hidden is None
                scale = 100 if field.endswith("percent") else 1
                yield metric, detector.name, np.nan if unknown else value / scale

    total = len(clips) if isinstance(clips, Sized) else count or 0
    samples = _samples(clips, total, fluxes, draws, key, measure, (None, *disturbances))
    return Board(detectors, samples)


def _samples(
    clips: Iterable[FlowClip],
    count: int,
    fluxes: Sequence[float],
    draws: int,
    key: tuple[str, ...],
    measure: Callable[[FlowClip, Frames], Measures],
    disturbances: Sequence[Disturbance | None] = (None,),
) -> pd.DataFrame:
    """Return what is measured on the counts of every clip, draw and flux, summed over draws."""
    parts = []
    cases = list(product(range(draws), disturbances, fluxes))
    with progress("Measuring flow", count * len(cases), "frame") as advance:
        for clip in clips:
            rows = []
            for draw, disturbance, flux in cases:
                counts = clip.counts(flux, draw, key, disturbance)
                for metric, name, value in measure(clip, counts):
                    known = np.isfinite(value)
                    case = metric, name, flux, str(disturbance or UNDISTURBED), clip.name
                    rows.append((*case, value if known else 0.0, float(known)))
                advance(1)
            sums = table.samples(rows).groupby([*table.CASE, "unit"], sort=False).sum()
            parts.append(sums.reset_index().assign(set=clip.set_name))
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()


def write_board(path: Path, board: Board, stand_in: str = "") -> None:
    """Write a row per pair, disturbance, flux and method, as CSV: means over the pair's draws.

    Without truth, rows say what stands in for it.
    """
    names = {"unit": "pair", "group": "disturbance", "photons": "photons_per_px"}
    rows = board.by_scene().reset_index().rename(columns=names)
    if stand_in:
        rows = rows.drop(columns=["set", "disturbance"]).assign(stand_in=stand_in)
        metrics = [m for m in (*FROM_STAND_IN.values(), *FROM_OTHERS.values()) if m in rows]
    else:
        frames = {detector.name: detector.memory_frames + 1 for detector in board.detectors}
        rows["frames"] = rows["method"].map(frames)
        metrics = list(METRICS)
    first = [name for name in rows if name not in metrics]
    text = rows[[*first, *metrics]].to_csv(index=False, float_format="%.6g", na_rep="nan")
    write_text(path, text)


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


def distances(first: Floats, second: Floats) -> Floats:
    """Return the lengths (...,) of the differences between velocities (..., 2), px."""
    return np.asarray(np.hypot(*np.moveaxis(first - second, -1, 0)))


def measures(distances_px: Floats) -> Iterator[tuple[str, float]]:
    """Yield median, mean, and the share above `FAR_PX` of the distances of pixels, (n,)."""
    yield MEDIAN, float(np.median(distances_px))
    yield MEAN, float(distances_px.mean())
    yield FAR, float((distances_px > FAR_PX).mean())


def pairs_without_truth(
    stack: ExitStack, paths: Sequence[Path], unit: Unit | None = None
) -> dict[str, tuple[_Light, _Light]]:
    """Return two pictures, or all pairs of successive frames, by name.

    The stack closes opened files. Raises UserError if there are not two frames.
    """
    opened = [stack.enter_context(open_footage(path, unit)) for path in paths]
    for footage in opened:
        check_decoded(footage.path, footage.shape, SENSED_BYTES)
    for note in dict.fromkeys(note for footage in opened for note in footage.notes):
        say(note)
    frames: list[_Light] = [
        partial(_luminance, footage, k) for footage in opened for k in range(len(footage))
    ]
    if len(opened) > 2 or (len(opened) == 2 and len(frames) > 2):
        raise UserError(
            f"benchmark pairs: {len(paths)} paths of {len(frames)} frames; without truth, give two "
            "pictures, a folder of pictures or a video"
        )
    if len(frames) < 2:
        raise UserError(f"{paths[0]} has one frame; give two pictures, or a video")
    if len({footage.shape for footage in opened}) > 1:
        sizes = " and ".join(f"{f.shape[1]} × {f.shape[0]}" for f in opened)
        raise UserError(f"{paths[0]} and {paths[1]} have {sizes} px; give one size")
    if len(opened) == 2:
        return {paths[0].stem: (frames[0], frames[1])}
    return {f"{paths[0].stem} {k}": pair for k, pair in enumerate(pairwise(frames))}


def _luminance(footage: Footage, index: int) -> Floats:
    return np.asarray(footage.frame(index) @ footage.luminance_shares, np.float64)


def distances_of_pairs(
    pairs: Mapping[str, tuple[_Light, _Light]],
    fluxes: Sequence[float],
    reference: Method,
    methods: Sequence[Method] | None = None,
    draws: int = 1,
) -> Board:
    """Return distances of methods, by default all two-frame methods, from both references.

    Metrics are those of `FROM_STAND_IN` and, for three or more methods, of `FROM_OTHERS`. Raises
    UserError if pictures or methods cannot be used, or no picture has any contrast.
    """
    with refused_as():
        chosen = methods or methods_and_baselines()
        detectors, standing_in = list(map(block_detector, chosen)), block_detector(reference)

        def clips() -> Iterator[FlowClip]:
            for name, (first, second) in pairs.items():
                light = np.stack([first(), second()])
                if light.min() == light.max():
                    say(f"{name}: both pictures are uniform; skipping the pair")
                    continue
                light /= light.mean()
                stand_in = standing_in.dense(*light * _CLEAN_PHOTONS)
                if np.isfinite(stand_in).any():
                    yield FlowClip(name, light, stand_in)
                else:
                    say(f"{name}: {standing_in.name} finds no flow; skipping the pair")

        def measure(clip: FlowClip, counts: Frames) -> Measures:
            known = np.isfinite(clip.flow).all(axis=-1)
            flows = {
                detector.name: dense_flow(detector, clip, counts).astype(np.float32)
                for detector in detectors
            }
            for name, flow in flows.items():
                references = [(FROM_STAND_IN, clip.flow)]
                other_flows = [flow_of for method, flow_of in flows.items() if method != name]
                if len(other_flows) > 1:
                    references.append((FROM_OTHERS, np.median(other_flows, axis=0)))
                for names, reference_flow in references:
                    for metric, value in measures(distances(flow, reference_flow)[known]):
                        yield names[metric], name, value

        key = ("pairs without truth",)
        samples = _samples(clips(), len(pairs), fluxes, draws, key, measure)
    if samples.empty:
        raise UserError(f"{', '.join(pairs)}: no contrast; give pictures with texture")
    return Board(detectors, samples)
