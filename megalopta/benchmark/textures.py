"""Drifting textures: photons for velocities of isolated blocks, and detection of motion.

Dead leaves of 251 rows drift by 3 columns per frame, are resized to 240 × 240 px by area, and drawn
at 1e3 to 1e7 photons per frame. Every method sees each 24 × 24 block alone with a margin of 7 px
(`flow.efficiency`) and is compared with the true velocity, 2.87 px per frame.

How well a method distinguishes motion from rest and right from left is measured on counts of other
textures, the same for all methods, at the size, speed and dark counts of the dissertation's Table
4.1, with one response per block.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from megalopta.assets_gen import generator
from megalopta.assets_gen.dead_leaves_model import dead_leaves
from megalopta.assets_gen.tileable_noise import tileable_noise
from megalopta.core.arrays import Floats
from megalopta.flow.detectors.base import Detector, milliseconds_per_frame
from megalopta.flow.detectors.blocks import BlockDetector, BlockGrid, block_grid
from megalopta.flow.detectors.registry import Method, method
from megalopta.flow.metrics.detection import Roc, d_prime, motion_evidence, rightward_evidence, roc
from megalopta.flow.metrics.translation_bound import (
    MedianPhotons,
    bound_photons,
    confined_velocities,
    cramer_rao_covariance,
    fisher_information,
    is_within,
    photons_for_half,
    texture_spectrum,
    unknown_texture_photons,
    variance_efficiency,
)
from megalopta.flow.stimuli.moving_template import MovingTemplate
from megalopta.flow.stimuli.photons import Counts, draw_counts
from megalopta.sensor.sampling import streams

SIZE_PX = 240
TEMPLATE_ROWS = 251
STEP_COLUMNS = 3
SPEED_PX = STEP_COLUMNS * SIZE_PX / TEMPLATE_ROWS
FRAMES = 8
MARGIN_PX = 7
LEVEL = 0.25
FLUXES = tuple(10 ** (3 + step / 3) for step in range(13))
"""1e3 to 1e7 photons per frame"""

EFFICIENCY_FLUXES = (3e4, 1e5, 3e5, 1e6, 3e6, 1e7)
_SEQUENCES = 8
"""Number of textures: windows of one texture are not independent."""
_TIMING_FLUX = 3e5
GRID = block_grid((SIZE_PX, SIZE_PX))


class Bounds(NamedTuple):
    """Photons per frame at which blocks can have a median error of 25 %, by number of frames."""

    known: float
    """Bound of the block's own pixels, with known texture"""
    with_margin: float
    """Bound of all pixels seen, block and margin"""
    unknown: float
    """Bound of the block's own pixels, with known power spectrum only"""


@dataclass(frozen=True)
class BlockPhotons:
    """Photons that one method needs; a row of the leaderboard."""

    detector: Detector
    needed: MedianPhotons
    """Photons per frame for a median error of 25 % of the truth; infinite if never reached"""
    frames: int
    """Frames behind one estimate"""
    bounds: Bounds
    ms_per_frame: float
    """CPU time of 240 × 240 px, in this process"""

    @property
    def efficiency(self) -> float:
        """Photons at the bound of the block over those that the method needs."""
        return self.bounds.known / self.needed.photons if self.needed.photons > 0 else math.inf


def sequences(count: int = _SEQUENCES) -> Floats:
    """Return sequences of dead leaves, (count, FRAMES, H, W), each frame of sum 1."""
    shape = (TEMPLATE_ROWS, TEMPLATE_ROWS + FRAMES * STEP_COLUMNS)
    clean = []
    for seed in range(count):
        texture = dead_leaves(shape, generator(seed, "leaderboard"), (3.0, 80.0))
        clean.append(MovingTemplate(texture, STEP_COLUMNS, SIZE_PX, "area").light(0, FRAMES))
    return np.stack(clean)


def information(clean: Floats, margin_px: int = 0) -> Floats:
    """Return J of every inner block at one photon per frame, (n, rows − 2, columns − 2, 2, 2).

    `margin_px` pixels around each block are included.
    """
    pixels = np.stack([fisher_information(each[-1], BlockGrid(GRID.shape, 1)) for each in clean])
    side, step = GRID.block_px + 2 * margin_px, GRID.block_px
    windows = sliding_window_view(pixels, (side, side), axis=(1, 2))
    first = step - margin_px
    rows, columns = (slice(first, first + (n - 2) * step, step) for n in (GRID.rows, GRID.columns))
    return np.asarray(windows[:, rows, columns].sum(axis=(-2, -1)))


def bounds(clean: Floats, frames: int) -> Bounds:
    """Return the bounds of `frames` frames of sequences (n, T, H, W)."""
    known, with_margin = (
        bound_photons(cramer_rao_covariance(information(clean, margin), frames), SPEED_PX, LEVEL)
        for margin in (0, MARGIN_PX)
    )
    newest = clean[:, -1]
    unknown = unknown_texture_photons(
        texture_spectrum(newest), float(newest.mean()), GRID.block_px**2, frames, SPEED_PX, LEVEL
    )
    return Bounds(known, with_margin, unknown)


def ranked(clean: Floats, methods: Iterable[Method]) -> list[BlockPhotons]:
    """Return the methods that give velocities, fewest photons first, on sequences (n, T, H, W)."""
    detectors = [each for each in map(method, methods) if isinstance(each, BlockDetector)]
    bounds_of = {each: bounds(clean, each) for each in {one.memory_frames + 1 for one in detectors}}

    @cache
    def counts(flux: float) -> Sequence[NDArray[np.unsignedinteger]]:
        return [leaf_counts(each, flux, index) for index, each in enumerate(clean)]

    def photons(detector: BlockDetector) -> BlockPhotons:
        def is_good(flux: float) -> NDArray[np.bool_]:
            found = [confined_velocities(detector, each, GRID, MARGIN_PX) for each in counts(flux)]
            return is_within(np.stack(found), (SPEED_PX, 0.0), LEVEL)

        needed = photons_for_half(is_good, FLUXES)
        time_ms = milliseconds_per_frame(detector, counts(_TIMING_FLUX)[0])
        frames = detector.memory_frames + 1
        return BlockPhotons(detector, needed, frames, bounds_of[frames], time_ms)

    found = map(photons, detectors)
    return sorted(found, key=lambda each: (each.needed.photons, each.detector.name))


def leaf_counts(
    clean: Floats, flux: float, sequence: int, repeat: int = 0
) -> NDArray[np.unsignedinteger]:
    """Return counts of a sequence at a flux; each (sequence, flux, repeat) has its own stream."""
    return draw_counts(clean * flux, 0, "leaderboard", sequence, f"{flux:.6g}", repeat)


def efficiencies(
    clean: Floats, detector: BlockDetector, fluxes: Sequence[float], draws: int
) -> list[float]:
    """Return bound over variance of one method at each flux, with its newest frames in full view.

    The variance of each block is over independent draws of each sequence of `clean`, (n, T, H, W).
    """
    frames = detector.memory_frames + 1
    least = cramer_rao_covariance(information(clean), frames)
    result = []
    for flux in fluxes:
        velocities = [
            [
                detector.respond(leaf_counts(each[-frames:], flux, index, repeat))[-1, 1:-1, 1:-1]
                for index, each in enumerate(clean)
            ]
            for repeat in range(1, draws + 1)
        ]
        result.append(variance_efficiency(np.array(velocities), least / flux))
    return result


SEED = 0
COLUMNS, SIZE, SPEED_COLUMNS = 251, 60, 5
VIEWS, SCORED_FRAMES = 4, 4
LAST_FRAME = 100
"""Frames are counted from the end: a method's result does not depend on how long others settle."""

DARK_COUNTS = 0.1 * (COLUMNS / SIZE) ** 2
CONTRAST = 0.5
RESPONSES = VIEWS * SCORED_FRAMES * 8 * 8
DIRECTIONS = {"still": 0, "right": 1, "left": -1}

_BRIGHT = 1e12
"""Photons per frame without significant noise, for methods that need counts."""


@dataclass(frozen=True)
class Detection:
    """Discriminability by one method at one flux."""

    method: str
    flux: float
    motion: float
    """d′ of moving against still"""
    direction: float
    """d′ of right against left"""
    false_alarms: float
    """Share of the still scene's blocks above half of the median noise-free response to motion"""
    curve: Roc
    """ROC of moving against still"""


def detections(methods: Sequence[Method], flux: float) -> list[Detection]:
    """Return the discriminability by each method at one flux (photons per frame), on one draw."""
    detectors = [method(each) for each in methods]
    settling = max(each.memory_frames for each in detectors)
    sequences = {
        name: [noisy_frames(name, view, settling + SCORED_FRAMES, flux) for view in range(VIEWS)]
        for name in DIRECTIONS
    }
    found = []
    for detector in detectors:
        responses = {
            name: settled_responses(detector, each, flux) for name, each in sequences.items()
        }
        still, moving = (motion_evidence(detector, responses[name]) for name in ("still", "right"))
        sides = (rightward_evidence(detector, responses[name]) for name in ("left", "right"))
        false_alarms = float(np.mean(still > motion_threshold(detector)))
        distances = d_prime(still, moving), d_prime(*sides)
        found.append(Detection(detector.name, flux, *distances, false_alarms, roc(still, moving)))
    return found


@cache
def motion_threshold(detector: Detector) -> float:
    """Half of the median noise-free evidence of motion."""
    frames = detector.memory_frames + SCORED_FRAMES
    means = [_light("right", view, frames) * _BRIGHT for view in range(VIEWS)]
    responses = settled_responses(detector, means, _BRIGHT)
    return float(np.median(motion_evidence(detector, responses))) / 2


def settled_responses(detector: Detector, sequences: Sequence[NDArray[Any]], flux: float) -> Floats:
    """Settled responses to all sequences, concatenated."""
    needed = detector.memory_frames + SCORED_FRAMES
    responses = [detector.respond(each[-needed:], SIZE**2 / flux) for each in sequences]
    return np.concatenate([each[-SCORED_FRAMES:] for each in responses])


def noisy_frames(direction: str, view: int, frames: int, flux: float) -> Counts:
    """Counts (frames, H, W) of a view that moves in a direction."""
    means = _light(direction, view, frames) * flux + DARK_COUNTS
    key = ("detection", direction, view, f"{flux:.6g}")
    return draw_counts(means, SEED, *key, first_frame=LAST_FRAME - frames)


@cache
def _light(direction: str, view: int, frames: int) -> Floats:
    """A drifting texture, (frames, SIZE, SIZE), as shares of the light of a frame."""
    columns = SPEED_COLUMNS * DIRECTIONS[direction]
    moving = MovingTemplate(_texture(view), columns, SIZE)
    return moving.light(columns * (LAST_FRAME - frames), frames)


@cache
def _texture(view: int) -> Floats:
    """A seamless log-normal texture, (COLUMNS, COLUMNS), of mean about 1."""
    side = float(COLUMNS)
    rng = streams.generator(SEED, "detection texture", view)
    noise = tileable_noise((COLUMNS, COLUMNS), (side, side), (4.0, side), 1.0, rng)
    return np.asarray(np.exp(np.sqrt(np.log1p(CONTRAST**2)) * noise))
