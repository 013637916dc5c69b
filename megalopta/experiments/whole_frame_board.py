"""Errors of velocity methods on whole frames over the photons per pixel, each with its interval.

Every method sees frames as they are, all around each block, and gives one velocity per block of
24 × 24 px, which is held against the mean true flow of the block. The outermost blocks are left
out. A block for which a method gives no velocity counts as one that it says stands still. The error
of a draw of photons is the median over the blocks, that of a method the mean over draws and scenes.
Its interval is a bootstrap over scenes; where there is one scene only, over draws.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from megalopta.arrays import Floats
from megalopta.experiments.whole_frame_scenes import Clip, middle
from megalopta.flow.detectors import METHODS, BlockDetector, Frames, Method, block_grid, method
from megalopta.flow.metrics import block_flow
from megalopta.flow.stimuli import draw_counts
from megalopta.sensor.sampling import generator

BLOCK_PX = 24
PHOTONS_PER_PX: tuple[float, ...] = (1.0, 3.0, 10.0, 30.0, 100.0, 1000.0)
_REPLICATES = 2000


@dataclass(frozen=True)
class FrameErrors:
    """Median endpoint errors of one method."""

    detector: BlockDetector
    px: Floats
    """(scenes, draws, fluxes), px per frame"""

    fluxes: tuple[float, ...] = PHOTONS_PER_PX
    """Photons per pixel and frame"""

    @property
    def frames(self) -> int:
        """Frames behind one estimate."""
        return self.detector.memory_frames + 1

    @property
    def mean(self) -> Floats:
        """Mean over scenes and draws, (fluxes,)."""
        return np.asarray(self.px.mean(axis=(0, 1)))

    @property
    def interval(self) -> Floats:
        """What holds the mean over infinitely many scenes, or draws, in 95 % of cases, (2, n)."""
        samples = self.px[0] if len(self.px) == 1 else self.px.mean(axis=1)
        rng, size = generator(0, "whole frames interval"), len(samples)
        means = samples[rng.integers(size, size=(_REPLICATES, size))].mean(axis=1)
        return np.asarray(np.percentile(means, (2.5, 97.5), axis=0))


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
    errors = np.empty((len(detectors), len(clips), draws, len(fluxes)))
    for scene, clip in enumerate(clips):
        for draw, place in np.ndindex(draws, len(fluxes)):
            key = ("whole frames", clip.name, f"{fluxes[place]:.6g}", draw)
            counts = draw_counts(clip.light * fluxes[place], 0, *key)
            for index, detector in enumerate(detectors):
                errors[index, scene, draw, place] = median_error(detector, counts, clip)
        after_scene()
    return [
        FrameErrors(detector, px, tuple(fluxes))
        for detector, px in zip(detectors, errors, strict=True)
    ]


def block_methods(frames: int) -> list[str]:
    """Return the names of the methods that give velocities of blocks from so many frames."""
    return [
        name
        for name, each in METHODS.items()
        if isinstance(each, BlockDetector) and each.memory_frames < frames
    ]


def block_detector(chosen: Method) -> BlockDetector:
    """Return a method that gives velocities of blocks. Raises ValueError for any other."""
    found = method(chosen)
    if not isinstance(found, BlockDetector):
        raise ValueError(f"{found.name} gives no velocity of blocks; choose a method that does")
    return found.model_copy(update={"block_px": BLOCK_PX})


def median_error(detector: BlockDetector, counts: Frames, clip: Clip) -> float:
    """Return the median endpoint error of one method over the blocks inside, px per frame.

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
    error = np.hypot(*np.moveaxis(np.nan_to_num(found) - truth, -1, 0))
    return float(np.median(error[known]))
