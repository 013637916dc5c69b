"""How well each method distinguishes motion from rest and right from left, over the photons.

All methods see the same counts of the same textures, at the size, speed and dark counts of the
dissertation's Table 4.1, and give one response per block.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.assets_gen.tileable_noise import tileable_noise
from megalopta.core.arrays import Floats
from megalopta.flow.detectors.base import Detector
from megalopta.flow.detectors.registry import Method, method
from megalopta.flow.metrics.detection import (
    Roc,
    d_prime,
    false_alarm_rate,
    motion_evidence,
    rightward_evidence,
    roc,
)
from megalopta.flow.stimuli.moving_template import MovingTemplate
from megalopta.flow.stimuli.photons import Counts, draw_counts
from megalopta.sensor.sampling.streams import generator

SEED = 0
COLUMNS, SIZE, SPEED_COLUMNS = 251, 60, 5
VIEWS, SCORED_FRAMES = 4, 4
LAST_FRAME = 100
"""Frames are counted from the end: how long others need to settle changes nothing for a method."""

DARK_COUNTS = 0.1 * (COLUMNS / SIZE) ** 2
CONTRAST = 0.5
RESPONSES = VIEWS * SCORED_FRAMES * 8 * 8
DIRECTIONS = {"still": 0, "right": 1, "left": -1}

_BRIGHT = 1e12
"""Photons per frame of which noise is nothing; methods that take counts must see many."""


@dataclass(frozen=True)
class Detection:
    """What one method can distinguish at one flux."""

    method: str
    flux: float
    motion: float
    """d′ of moving against still"""

    direction: float
    """d′ of right against left"""

    false_alarms: float
    """Share of the still scene's blocks beyond half of the median noise-free response to motion"""

    curve: Roc
    """Of moving against still"""


def detections(methods: Sequence[Method], flux: float) -> list[Detection]:
    """Return what each method can distinguish at one flux (photons per frame), on one draw."""
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
        false_alarms = false_alarm_rate(still, motion_threshold(detector))
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
    """Settled responses to all sequences, one after the other."""
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
    """A texture that drifts, (frames, SIZE, SIZE), as shares of the light of a frame."""
    columns = SPEED_COLUMNS * DIRECTIONS[direction]
    moving = MovingTemplate(_texture(view), columns, SIZE)
    return moving.light(columns * (LAST_FRAME - frames), frames)


@cache
def _texture(view: int) -> Floats:
    """A log-normal texture without a seam, (COLUMNS, COLUMNS), of mean about 1."""
    side = float(COLUMNS)
    rng = generator(SEED, "detection texture", view)
    noise = tileable_noise((COLUMNS, COLUMNS), (side, side), (4.0, side), 1.0, rng)
    return np.asarray(np.exp(np.sqrt(np.log1p(CONTRAST**2)) * noise))
