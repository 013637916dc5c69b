"""Errors of velocity methods on whole frames by photons per pixel, with intervals.

Every method gives one velocity per block of 24 × 24 px, which is compared with the mean true flow
of the block. The outermost blocks are excluded. A block without velocity counts as zero motion.
Next to the median there are the mean, shares of blocks that are far off, Fl and WAUC
(`flow.metrics.endpoint_error`, with blocks for pixels), and means by speed and by occlusion. A
method's value is the mean over draws and scenes, with its interval over scenes (`table`).

**Without truth** there are two stand-ins. One is the flow by a method, the reference, between the
pictures without photon noise, which favors it and similar methods. The other is the median of all
other methods on the same photons, which may share an error.
"""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
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
from megalopta.benchmark.methods import BLOCK_PX, block_detector, methods_and_baselines
from megalopta.benchmark.table import FAR, FAR_PX, MEAN, MEDIAN
from megalopta.core.arrays import Floats
from megalopta.core.bounded import check_decoded
from megalopta.core.errors import UserError, refused_as
from megalopta.core.files import write_text
from megalopta.core.pictures import SENSED_BYTES
from megalopta.core.progress import progress, say
from megalopta.flow.detectors.base import Frames
from megalopta.flow.detectors.blocks import BlockDetector, BlockGrid, block_grid
from megalopta.flow.detectors.registry import Method
from megalopta.flow.metrics import endpoint_error
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
"""Group of blocks and field of `endpoint_error.DenseError` by metric; speeds are px per frame"""
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

_CLEAN_PHOTONS = 1000.0
"""Photons per pixel of the noise-free light that the reference sees."""

Measures: TypeAlias = Iterator[tuple[str, str, float]]
"""Metric, method and value; NaN is unknown"""

_Light: TypeAlias = Callable[[], Floats]
"""Returns the luminance (H, W) of a picture when needed."""


@dataclass(frozen=True, eq=False)
class Board:
    """Errors of methods over the blocks of scenes, by photons per pixel and frame."""

    detectors: Sequence[BlockDetector]
    samples: pd.DataFrame
    """A row per metric, method, photons and scene (`table.samples`): the sum over known draws"""

    @property
    def scenes(self) -> list[str]:
        """Names of the scenes."""
        return list(self.samples["unit"].unique())

    def means(self) -> pd.DataFrame:
        """Return the mean of every metric over the scenes that have it (`table.means`)."""
        return table.means(self.samples)

    def by_scene(self) -> pd.DataFrame:
        """Return the mean over draws: a row per scene, method and photons, a column per metric."""
        rows = self.samples.assign(value=self.samples["total"] / self.samples["blocks"])
        names = [detector.name for detector in self.detectors]
        wide = rows.pivot(index=["unit", "method", "photons"], columns="metric", values="value")
        order = (self.scenes, names, list(rows["photons"].unique()))
        return wide.reindex(pd.MultiIndex.from_product(order, names=wide.index.names))


def frame_errors(
    clips: Iterable[FlowClip],
    methods: Sequence[Method],
    fluxes: Sequence[float] = PHOTONS_PER_PX,
    draws: int = 1,
) -> Board:
    """Return the errors of methods on the same photons of all clips, means per pixel and frame.

    Raises ValueError if a method gives no velocity of blocks or needs more frames than a clip has,
    or a clip is too small.
    """
    detectors = [block_detector(method) for method in methods]
    scenes, key = list(clips), ("whole frames",)
    for detector in detectors:  # compiled before time is measured
        block_velocities(detector, scenes[0], scenes[0].counts(fluxes[0], 0, key))

    def measure(clip: FlowClip, counts: Frames) -> Measures:
        truth = true_velocities(clip)
        known = np.isfinite(truth).all(axis=-1)
        occluded = None
        if clip.hidden is not None:
            hidden = clip.hidden & np.isfinite(clip.flow).all(axis=-1)
            share = endpoint_error.block_share(hidden[np.newaxis], _grid(clip))[0, 1:-1, 1:-1]
            occluded = np.asarray(share >= endpoint_error.OCCLUDED_SHARE)
        for detector in detectors:
            start = time.process_time()
            velocities = block_velocities(detector, clip, counts)
            yield SECONDS, detector.name, time.process_time() - start
            for metric, value in measures(distances(velocities, truth)[known]):
                yield metric, detector.name, value
            dense = endpoint_error.DenseErrors()
            dense.add(velocities, truth, occluded)
            for metric, (group, field) in _DENSE.items():
                value = asdict(dense.of(group))[field]
                unknown = group == "visible" and occluded is None
                scale = 100 if field.endswith("percent") else 1
                yield metric, detector.name, np.nan if unknown else value / scale

    return Board(detectors, _samples(scenes, len(scenes), fluxes, draws, key, measure))


def _samples(
    clips: Iterable[FlowClip],
    count: int,
    fluxes: Sequence[float],
    draws: int,
    key: tuple[str, ...],
    measure: Callable[[FlowClip, Frames], Measures],
) -> pd.DataFrame:
    """Return what is measured on the counts of every clip, draw and flux, summed over draws."""
    rows = []
    with progress("Drawing photons", count, "pair") as advance:
        for clip in clips:
            for draw, flux in product(range(draws), fluxes):
                for metric, name, value in measure(clip, clip.counts(flux, draw, key)):
                    known = np.isfinite(value)
                    case = metric, name, flux, "all", clip.name
                    rows.append((*case, value if known else 0.0, float(known)))
            advance(1)
    draws_of_all = table.samples(rows).groupby([*table.CASE, "unit"], sort=False)
    return draws_of_all.sum().reset_index()


def write_board(path: Path, board: Board, stand_in: str = "") -> None:
    """Write a row per pair, method and flux, as CSV: means over the draws of the pair.

    Without truth, rows say what stands in for it.
    """
    names = {"unit": "pair", "photons": "photons_per_px"}
    rows = board.by_scene().reset_index().rename(columns=names)
    if stand_in:
        rows.insert(3, "stand_in", stand_in)
        metrics = [m for m in (*FROM_STAND_IN.values(), *FROM_OTHERS.values()) if m in rows]
    else:
        frames = {detector.name: detector.memory_frames + 1 for detector in board.detectors}
        rows.insert(2, "frames", rows["method"].map(frames))
        metrics = list(METRICS)
    first = [name for name in rows if name not in metrics]
    text = rows[[*first, *metrics]].to_csv(index=False, float_format="%.6g", na_rep="nan")
    write_text(path, text)


def block_velocities(detector: BlockDetector, clip: FlowClip, counts: Frames) -> Floats:
    """Return velocities of the inner blocks, (rows, columns, 2), 0 if a method gives none.

    It sees the frames in the middle of counts (T, H, W). Raises ValueError if it needs more.
    """
    needed = detector.memory_frames + 1
    if len(counts) < needed:
        raise ValueError(f"{clip.name} has {len(counts)} frames; {detector.name} needs {needed}")
    first = (len(counts) - needed) // 2
    return np.nan_to_num(detector.respond(counts[first : first + needed])[-1, 1:-1, 1:-1])


def _grid(clip: FlowClip) -> BlockGrid:
    return block_grid((clip.light.shape[1], clip.light.shape[2]), BLOCK_PX)


def true_velocities(clip: FlowClip) -> Floats:
    """Return the mean flow of the inner blocks, (rows, columns, 2); NaN if unknown.

    A block needs flow for half of its pixels. Raises ValueError if no block has it.
    """
    flow = endpoint_error.block_flow(clip.flow[np.newaxis], _grid(clip))[0, 1:-1, 1:-1]
    if not np.isfinite(flow).all(axis=-1).any():
        raise ValueError(
            f"{clip.name}: no block of {BLOCK_PX} px has half of its flow known; give other flow"
        )
    return flow


def distances(first: Floats, second: Floats) -> Floats:
    """Return the lengths (...,) of the differences between velocities (..., 2), px."""
    return np.asarray(np.hypot(*np.moveaxis(first - second, -1, 0)))


def measures(distances_px: Floats) -> Iterator[tuple[str, float]]:
    """Yield median, mean, and the share above `FAR_PX` of the distances of blocks, (n,)."""
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
                yield FlowClip(name, light, standing_in.dense(*light * _CLEAN_PHOTONS))

        def measure(clip: FlowClip, counts: Frames) -> Measures:
            stand_in = true_velocities(clip)
            known = np.isfinite(stand_in).all(axis=-1)
            flows = {
                detector.name: block_velocities(detector, clip, counts) for detector in detectors
            }
            for name, flow in flows.items():
                references = [(FROM_STAND_IN, stand_in)]
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
