"""Responses of NDM and NDS to a moving plate, captured and simulated, and transfer functions."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.arrays import Floats
from megalopta.comparison.cycle import align, plate_cycle
from megalopta.comparison.moving import exposed
from megalopta.errors import UserError
from megalopta.experiments import (
    FRAME_RATE_HZ,
    FRAMES,
    TIME_CONSTANTS_S,
    UNITS,
    crossing_peaks,
    detector,
    pooled,
)
from megalopta.sensor import Sensor
from megalopta.sensor.compare import CountedFrames, Difference, difference

_PERIOD = 2 * FRAMES
_REPEATS = 4
"""Simulated passages for each captured one."""


class SpeedResponse(NamedTuple):
    """Peak responses of one detector at one speed, captured and simulated: crossings."""

    name: str
    speed_mm_s: float
    captured: Floats
    """(crossings,), mean over rows and detectors of the array."""
    simulated: Floats
    difference: Difference


def plate_responses(
    captured: Mapping[float, CountedFrames], device: Sensor, margin: float, seed: int = 0
) -> list[SpeedResponse]:
    """Compare responses to a plate at each speed (mm/s), over whole passages of it.

    Raises
    ------
    UserError
        When a recording is not of 16 × 16 pixels at 10 frames/s, or has fewer than two whole
        passages without a gap.
    """
    found = []
    for speed, frames in sorted(captured.items()):
        cycle = plate_cycle(speed, device)
        index = align(frames, cycle).frame
        starts = _passages(index, speed)
        chosen = (starts[:, None] + np.arange(_PERIOD)).ravel()
        light = np.tile(cycle.rates_hz[index[chosen]], (_REPEATS, 1, 1))
        counts, simulated = frames.counts[chosen], exposed(frames, light, device, seed).counts
        for name in TIME_CONSTANTS_S:
            a, b = (
                crossing_peaks(detector(name), pooled(each)).mean(axis=(1, 2))
                for each in (counts, simulated)
            )
            title = f"{name} response at {speed:g} mm/s"
            apart = difference(title, a, b, UNITS[name], margin)
            found.append(SpeedResponse(name, speed, a, b, apart))
    return found


def _passages(index: NDArray[np.int64], speed: float) -> NDArray[np.intp]:
    """First frame of every whole passage, of which none is missing."""
    starts = np.flatnonzero(index % _PERIOD == 0)
    starts = starts[starts + _PERIOD <= len(index)]
    ways = np.arange(_PERIOD)
    whole = [at for at in starts if np.array_equal(index[at : at + _PERIOD], index[at] + ways)]
    if len(whole) < 2:
        raise UserError(
            f"plate at {speed:g} mm/s: {len(whole)} whole passages in {len(index)} frames; capture "
            f"{3 * _PERIOD} frames or more at {FRAME_RATE_HZ:g} frames/s"
        )
    return np.array(whole)
