"""Errors of velocity methods on whole frames over the photons per pixel, each with its interval.

Every method sees frames as they are, all around each block, and gives one velocity per block of
24 × 24 px, which is held against the mean true flow of the block. The outermost blocks are left
out. A block for which a method gives no velocity counts as one that it says stands still.

Three measures of the errors of a scene's blocks: their median, their mean, and the share of blocks
that are off by more than 3 px. A method that is far off in a third of the blocks may have the least
median and the largest mean, so none of the three stands for the others. That of a method is the
mean over draws and scenes; its interval is a bootstrap over scenes, where there is more than one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from megalopta.benchmark.clips import Clip, middle
from megalopta.benchmark.methods import BLOCK_PX, block_detector
from megalopta.core.arrays import Floats
from megalopta.flow.detectors.base import Frames
from megalopta.flow.detectors.blocks import BlockDetector, block_grid
from megalopta.flow.detectors.registry import Method
from megalopta.flow.metrics.endpoint_error import block_flow
from megalopta.flow.stimuli.photons import draw_counts
from megalopta.sensor.sampling import generator

PHOTONS_PER_PX: tuple[float, ...] = (1.0, 3.0, 10.0, 30.0, 100.0, 1000.0)
FAR_PX = 3.0
"""Endpoint error beyond which a block is counted as far off"""

_MEASURES = 3
_REPLICATES = 2000


@dataclass(frozen=True)
class OverScenes:
    """One measure of a method's errors in each scene."""

    of_scenes: Floats
    """(scenes, fluxes)"""

    @property
    def mean(self) -> Floats:
        """Mean over scenes, (fluxes,)."""
        return np.asarray(self.of_scenes.mean(axis=0))

    @property
    def interval(self) -> Floats:
        """What holds the mean over infinitely many scenes in 95 % of cases, (2, fluxes).

        NaN where there is one scene: it does not tell how much scenes differ.
        """
        scenes, fluxes = self.of_scenes.shape
        if scenes == 1:
            return np.full((2, fluxes), np.nan)
        rng = generator(0, "whole frames interval")
        means = self.of_scenes[rng.integers(scenes, size=(_REPLICATES, scenes))].mean(axis=1)
        return np.asarray(np.percentile(means, (2.5, 97.5), axis=0))


@dataclass(frozen=True)
class FrameErrors:
    """Endpoint errors of one method over the blocks of each scene."""

    detector: BlockDetector
    scenes: tuple[str, ...]
    """Names of the scenes"""

    median_px: OverScenes
    """Median over the blocks, px per frame"""

    mean_px: OverScenes
    """Mean over the blocks, px per frame"""

    far: OverScenes
    """Share of the blocks that are off by more than 3 px, 0 to 1"""

    fluxes: tuple[float, ...] = PHOTONS_PER_PX
    """Photons per pixel and frame"""

    @property
    def frames(self) -> int:
        """Frames behind one estimate."""
        return self.detector.memory_frames + 1


def frame_errors(
    clips: Sequence[Clip],
    methods: Sequence[Method],
    fluxes: Sequence[float] = PHOTONS_PER_PX,
    draws: int = 1,
    after_scene: Callable[[], object] = lambda: None,
) -> list[FrameErrors]:
    """Return the errors of methods on the same photons of all clips.

    Parameters
    ----------
    clips
        Of enough frames for all methods.
    methods
        By name or themselves.
    fluxes
        Photons per pixel and frame, on average over a clip.
    draws : int
        Of the photons of each clip.
    after_scene
        Called after each clip.

    Raises
    ------
    ValueError
        When a method gives no velocity of blocks, sees more frames than a clip has, or a clip is
        too small.
    """
    detectors = [block_detector(each) for each in methods]
    errors = np.empty((len(detectors), _MEASURES, len(clips), draws, len(fluxes)))
    for scene, clip in enumerate(clips):
        for draw, place in np.ndindex(draws, len(fluxes)):
            key = ("whole frames", clip.name, f"{fluxes[place]:.6g}", draw)
            counts = draw_counts(clip.light * fluxes[place], 0, *key)
            for index, detector in enumerate(detectors):
                errors[index, :, scene, draw, place] = measures(
                    block_errors(detector, counts, clip)
                )
        after_scene()
    scenes = tuple(clip.name for clip in clips)
    found = []
    for detector, each in zip(detectors, errors.mean(axis=-2), strict=True):
        median_px, mean_px, far = (OverScenes(of_scenes) for of_scenes in each)
        found.append(FrameErrors(detector, scenes, median_px, mean_px, far, tuple(fluxes)))
    return found


def measures(error_px: Floats) -> Floats:
    """Return median, mean, and the share beyond 3 px, of endpoint errors, (3,)."""
    return np.array([np.median(error_px), error_px.mean(), (error_px > FAR_PX).mean()])


def block_errors(detector: BlockDetector, counts: Frames, clip: Clip) -> Floats:
    """Return the endpoint errors of one method in the blocks inside, px per frame, (blocks,).

    Parameters
    ----------
    detector
        Sees the frames in the middle.
    counts : (T, H, W)
    clip
        Where the true flow is known; a block needs it for half of its pixels.
    """
    needed = detector.memory_frames + 1
    if len(counts) < needed:
        raise ValueError(f"{clip.name} has {len(counts)} frames; {detector.name} needs {needed}")
    found = detector.respond(middle(counts, needed))[-1, 1:-1, 1:-1]
    grid = block_grid((counts.shape[1], counts.shape[2]), BLOCK_PX)
    truth = block_flow(clip.flow[np.newaxis], grid)[0, 1:-1, 1:-1]
    known = np.isfinite(truth).all(axis=-1)
    if not known.any():
        raise ValueError(f"{clip.name}: the flow is known in half of no block of {BLOCK_PX} px")
    return np.asarray(np.hypot(*np.moveaxis(np.nan_to_num(found) - truth, -1, 0))[known])
