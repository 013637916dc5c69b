"""Errors of velocity methods on whole frames by photons per pixel, with intervals.

Every method sees whole frames and gives one velocity per block of 24 × 24 px, which is compared
with the mean true flow of the block. The outermost blocks are excluded. A block without velocity
counts as zero motion.

A method that is far off in a third of the blocks may have the least median and the largest mean. So
next to the median there are the mean, the shares of blocks off by more than 1, 3 and 5 px, Fl and
WAUC (`flow.metrics.endpoint_error`, with blocks for pixels), and means by speed and by occlusion,
with the processor time that the method took. A block is occluded where a tenth of it is hidden in
the next frame. A method's value is the mean over draws and scenes, with its interval over scenes
(`table`), if there is more than one.
"""

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain, product
from pathlib import Path
from types import MappingProxyType

import numpy as np

from megalopta.benchmark.clips import FlowClip, middle
from megalopta.benchmark.methods import BLOCK_PX, block_detector, methods_and_baselines
from megalopta.benchmark.pairs_on_disk import Files, read_pair
from megalopta.benchmark.table import (
    Case,
    Interval,
    Samples,
    gathered,
    mean_of,
    measure_samples,
)
from megalopta.core.arrays import Floats, Mask
from megalopta.core.errors import refused_as
from megalopta.core.files import write_csv
from megalopta.core.progress import progress
from megalopta.flow.detectors.base import Frames
from megalopta.flow.detectors.blocks import BlockDetector, block_grid
from megalopta.flow.detectors.registry import Method
from megalopta.flow.metrics.endpoint_error import (
    OCCLUDED_SHARE,
    DenseErrors,
    block_flow,
    block_share,
)

PHOTONS_PER_PX: tuple[float, ...] = (1.0, 3.0, 10.0, 30.0, 100.0, 1000.0)
FAR_PX = 3.0
"""Endpoint error from which a block counts as far off"""

MEDIAN, MEAN, FAR = "median_epe_px", "mean_epe_px", "share_beyond_3_px"
SECONDS = "cpu_s"
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
"""Heads of columns by metric; mean errors by true motion, px per frame, and by occlusion"""

_OF_GROUPS = "slow", "medium", "fast", "visible", "occluded"
_PAIR_FRAMES = 2
_KEY = ("whole frames",)


@dataclass(frozen=True)
class Board:
    """Errors of methods over the blocks of scenes, by photons per pixel and frame."""

    scenes: tuple[str, ...]
    detectors: tuple[BlockDetector, ...]
    fluxes: tuple[float, ...]
    samples: Samples
    """(scenes, draws) of each metric"""

    def of_scenes(self, metric: str, detector: BlockDetector, flux: float) -> Floats:
        """Return the means over the draws of each scene, (scenes,)."""
        return np.asarray(self.samples[Case(metric, detector.name, flux)].mean(axis=-1))

    def over_scenes(self, metric: str, detector: BlockDetector, flux: float) -> Interval:
        """Return the mean over scenes that have the metric, NaN without any, with its interval."""
        return mean_of(self.samples[Case(metric, detector.name, flux)])


def frame_errors(
    clips: Sequence[FlowClip],
    methods: Sequence[Method],
    fluxes: Sequence[float] = PHOTONS_PER_PX,
    draws: int = 1,
    after_scene: Callable[[], object] = lambda: None,
) -> Board:
    """Return the errors of methods on the same photons of all clips.

    Fluxes are mean photons per pixel and frame of a clip. Raises ValueError if a method gives no
    velocity of blocks or needs more frames than a clip has, or a clip is too small.
    """
    detectors = tuple(block_detector(each) for each in methods)
    for each in detectors:  # compiled before time is measured
        answers(each, clips[0], clips[0].counts(fluxes[0], 0, _KEY))
    parts = []
    for clip in clips:
        draw, errors = partial(clip.counts, key=_KEY), partial(_errors, detectors, clip)
        parts.append(measure_samples(draw, errors, fluxes, draws))
        after_scene()
    scenes = tuple(clip.name for clip in clips)
    return Board(scenes, detectors, tuple(fluxes), gathered(parts))


def errors_of_pairs(
    pairs: Mapping[str, Files],
    fluxes: Sequence[float],
    methods: Sequence[Method] | None = None,
    draws: int = 1,
) -> Board:
    """Return the errors of methods, by default all two-frame methods, on pairs of files.

    Raises UserError if a file cannot be used, or a method does not run on two frames.
    """
    clips = [read_pair(name, files) for name, files in pairs.items()]
    with progress("Drawing photons", len(clips), "pair") as advance, refused_as():
        chosen = methods or methods_and_baselines(_PAIR_FRAMES)
        return frame_errors(clips, chosen, fluxes, draws, lambda: advance(1))


def write_board(
    path: Path, board: Board, metrics: Iterable[str] = METRICS, stand_in: str = ""
) -> None:
    """Write a row per pair, method and flux, as CSV: means over the draws of the pair.

    Without truth, rows say what stands in for it.
    """
    own = ("photons_per_px", "stand_in") if stand_in else ("frames", "photons_per_px")
    rows = (
        (
            *(pair, each.name),
            *((flux, stand_in) if stand_in else (each.memory_frames + 1, flux)),
            *(float(board.of_scenes(metric, each, flux)[place]) for metric in metrics),
        )
        for place, pair in enumerate(board.scenes)
        for each, flux in product(board.detectors, board.fluxes)
    )
    write_csv(path, ("pair", "method", *own, *metrics), rows)


def _errors(
    detectors: Iterable[BlockDetector], clip: FlowClip, counts: Frames, _: float
) -> Iterator[tuple[str, str, Floats]]:
    """Yield statistics of methods' endpoint errors in the inner blocks, px per frame."""
    truth = blocks_of(clip)
    for each in detectors:
        start = time.process_time()
        found = answers(each, clip, counts)
        spent = np.array([time.process_time() - start])
        error_px = distances(found, truth)[np.isfinite(truth).all(axis=-1)]
        tails = _tails(found, truth, _occluded(clip))
        for metric, values in chain([(SECONDS, spent)], measures(error_px), tails):
            yield metric, each.name, values


def _tails(found: Floats, truth: Floats, occluded: Mask | None) -> Iterator[tuple[str, Floats]]:
    """Yield the other metrics of velocities of blocks (rows, columns, 2); NaN without blocks."""
    errors = DenseErrors()
    errors.add(found, truth, occluded)
    every = errors.of("all")
    shares = every.over_1px_percent, every.over_5px_percent, every.fl_percent, every.wauc_percent
    means = [errors.of(group).epe_px for group in _OF_GROUPS]
    if occluded is None:
        means[_OF_GROUPS.index("visible")] = math.nan
    names = [name for name in METRICS if name not in (MEDIAN, MEAN, FAR, SECONDS)]
    for name, value in zip(names, (*(each / 100 for each in shares), *means), strict=True):
        yield name, np.array([value])


def _occluded(clip: FlowClip) -> Mask | None:
    """Return which inner blocks are occluded, (rows, columns); None if unknown."""
    if clip.hidden is None:
        return None
    hidden = clip.hidden & np.isfinite(clip.flow).all(axis=-1)
    grid = block_grid((clip.light.shape[1], clip.light.shape[2]), BLOCK_PX)
    return np.asarray(block_share(hidden[np.newaxis], grid)[0, 1:-1, 1:-1] >= OCCLUDED_SHARE)


def answers(detector: BlockDetector, clip: FlowClip, counts: Frames) -> Floats:
    """Return velocities of the inner blocks, (rows, columns, 2), 0 if a method gives none.

    It sees the frames in the middle of counts (T, H, W). Raises ValueError if it needs more.
    """
    needed = detector.memory_frames + 1
    if len(counts) < needed:
        raise ValueError(f"{clip.name} has {len(counts)} frames; {detector.name} needs {needed}")
    return np.nan_to_num(detector.respond(middle(counts, needed))[-1, 1:-1, 1:-1])


def blocks_of(clip: FlowClip) -> Floats:
    """Return the mean flow of the inner blocks, (rows, columns, 2); NaN if unknown.

    A block needs flow for half of its pixels. Raises ValueError if no block has it.
    """
    grid = block_grid((clip.light.shape[1], clip.light.shape[2]), BLOCK_PX)
    flow = block_flow(clip.flow[np.newaxis], grid)[0, 1:-1, 1:-1]
    if not np.isfinite(flow).all(axis=-1).any():
        raise ValueError(
            f"{clip.name}: no block of {BLOCK_PX} px has half of its flow known; give other flow"
        )
    return flow


def distances(one: Floats, other: Floats) -> Floats:
    """Return the lengths (...,) of the differences between velocities (..., 2), px."""
    return np.asarray(np.hypot(*np.moveaxis(one - other, -1, 0)))


def measures(distances_px: Floats) -> Iterator[tuple[str, Floats]]:
    """Yield median, mean, and the share above `FAR_PX` of the distances of blocks, (n,)."""
    yield MEDIAN, np.array([np.median(distances_px)])
    yield MEAN, np.array([distances_px.mean()])
    yield FAR, np.array([(distances_px > FAR_PX).mean()])
