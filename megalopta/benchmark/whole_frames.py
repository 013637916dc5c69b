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
from typing import Any, TypeAlias

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from megalopta.benchmark import table
from megalopta.benchmark.clips import FlowClip
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
METRICS: Mapping[str, tuple[str, str, str]] = MappingProxyType(
    {
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
)
"""Head of its column, group of pixels and field of `endpoint_error.DenseError` by metric"""
FROM_OTHERS = "mean_px_from_others"
"""Mean distance from the median of the flow of all other methods, where nobody knows the truth"""

OWN_METHODS = "PF", "PF-fast", "PPF", "PM", "PPM"
"""Methods of this program for photon counts: where the first that was measured does not have the
lowest error, a verdict says so"""
UNDISTURBED = "none"

_CLEAN_PHOTONS = 1000.0
"""Photons per pixel of the noise-free light that the reference sees."""

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

    def of(self, set_name: str | None, flux: float) -> pd.DataFrame:
        """Return the samples of a set, or of all, at a flux."""
        samples = self.samples[self.samples["photons"] == flux]
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
    `OWN_METHODS`, has Student's 95 % interval over pairs.
    """
    if len(board.detectors) < 2:
        return
    groups, fluxes = (board.samples[name].unique() for name in ("group", "photons"))
    for group, (set_name, pairs), flux in product(groups, board.parts().items(), fluxes):
        rows = board.of(set_name, flux)
        rows = rows[rows["group"] == group]
        mean, median = (_lead(rows[rows["metric"] == name]) for name in (MEAN, MEDIAN))
        disturbed = "" if group == UNDISTURBED else f", {group}"
        yield f"{pairs}{disturbed}, {flux:g} photons: lowest mean {mean}; lowest median {median}"


def _lead(rows: pd.DataFrame) -> str:
    """Return the method of the least mean, and how far the next and our own are above it."""
    sums = table.by_method(rows)
    mean_px = {name: table.mean(errors) for name, errors in sums.items()}
    first, *others = sorted(mean_px, key=lambda name: mean_px[name])
    own = [name for name in OWN_METHODS if name in sums][:1]
    above = []
    for name in dict.fromkeys((others[0], *(own if own != [first] else []))):
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
    count: int = 0,
    with_others: bool = False,
) -> Board:
    """Return the errors of methods on the same photons of all clips, means per pixel and frame.

    One clip is in memory at a time; `count` is their number, if an iterator gives them. Three or
    more methods are also compared `with_others`. Raises ValueError if a method gives no velocity or
    needs more frames than a clip has, or a clip is too small.
    """
    detectors = [block_detector(method) for method in methods]
    count = len(clips) if isinstance(clips, Sized) else count
    cases = list(product(range(draws), (None, *disturbances), fluxes))
    parts = list[pd.DataFrame]()
    with progress("Measuring flow", count * len(cases), "draw") as advance:
        for clip in clips:
            rows = list[tuple[Any, ...]]()
            for draw, disturbance, flux in cases:
                counts = clip.counts(flux, draw, ("whole frames",), disturbance)
                if not (parts or rows):  # compiled before time is measured
                    for detector in detectors:
                        dense_flow(detector, clip, counts)
                for metric, name, value in _measures(detectors, clip, counts, with_others):
                    known = np.isfinite(value)
                    case = metric, name, flux, str(disturbance or UNDISTURBED), clip.name
                    rows.append((*case, value if known else 0.0, float(known)))
                advance()
            sums = table.samples(rows).groupby([*table.CASE, "unit"], sort=False).sum()
            parts.append(sums.reset_index().assign(set=clip.set_name))
    if not parts:
        raise ValueError("no pair with texture; give others")
    return Board(detectors, pd.concat(parts, ignore_index=True))


def _measures(
    detectors: Sequence[BlockDetector], clip: FlowClip, counts: Frames, with_others: bool
) -> Iterator[tuple[str, str, float]]:
    """Yield metric, method and value; NaN is unknown."""
    known, flows = np.isfinite(clip.flow).all(axis=-1), dict[str, NDArray[np.float32]]()
    for detector in detectors:
        start = time.process_time()
        flow = dense_flow(detector, clip, counts)
        yield SECONDS, detector.name, time.process_time() - start
        yield MEDIAN, detector.name, float(np.median(np.hypot(*(flow - clip.flow)[known].T)))
        errors = DenseErrors()
        errors.add(flow, clip.flow, clip.hidden)
        for metric, (_, group, field) in METRICS.items():
            if group and (group != "visible" or clip.hidden is not None):
                scale = 0.01 if field.endswith("percent") else 1
                yield metric, detector.name, scale * asdict(errors.of(group))[field]
        if clip.foreground is not None:
            objects = DenseErrors()
            objects.add(flow, np.where(clip.foreground[..., np.newaxis], clip.flow, np.nan))
            yield FOREGROUND, detector.name, 0.01 * objects.of("all").fl_percent
        if with_others:
            flows[detector.name] = flow.astype(np.float32)
    for name in flows if len(flows) > 2 else ():
        others = np.median([flows[other] for other in flows if other != name], axis=0)
        yield FROM_OTHERS, name, float(np.hypot(*(flows[name] - others)[known].T).mean())


def write_board(path: Path, board: Board, stand_in: str = "") -> None:
    """Write a row per pair, disturbance, flux and method, as CSV: means over the pair's draws.

    Without truth, rows say what stands in for it.
    """
    frames = {detector.name: detector.memory_frames + 1 for detector in board.detectors}
    rows = board.by_scene().reindex(columns=[*METRICS, FROM_OTHERS]).reset_index()
    rows.insert(5, "frames", rows["method"].map(frames))
    names = {"unit": "pair", "group": "disturbance", "photons": "photons_per_px"}
    if stand_in:
        distances = {name: name.replace("epe_", "") for name in METRICS if name != SECONDS}
        names |= {name: f"{distance}_from_stand_in" for name, distance in distances.items()}
        rows.insert(6, "stand_in", stand_in)
    else:
        del rows[FROM_OTHERS]
    text = rows.rename(columns=names).to_csv(index=False, float_format="%.6g", na_rep="nan")
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


def _luminance(footage: Footage, index: int) -> Floats:
    return np.asarray(footage.frame(index) @ footage.luminance_shares, np.float64)


def clips_without_truth(
    pairs: Mapping[str, tuple[_Light, _Light]], reference: Method
) -> Iterator[FlowClip]:
    """Yield pairs whose true flow is replaced by that of the reference without photon noise.

    A pair without contrast, or in which the reference finds no flow, is left out.
    """
    detector = block_detector(reference)
    for name, (first, second) in pairs.items():
        light = np.stack([first(), second()])
        light /= light.mean() or 1
        flow = detector.dense(*light * _CLEAN_PHOTONS)
        if light.min() == light.max() or not np.isfinite(flow).any():
            say(f"{name}: no contrast, or {detector.name} finds no flow; skipping the pair")
        else:
            yield FlowClip(name, light, flow)
