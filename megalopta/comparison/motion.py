"""Responses of NDM and NDS to a moving plate, captured and simulated, and transfer functions."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.errors import UserError
from megalopta.experiments import (
    FRAMES,
    PIXELS,
    TIME_CONSTANTS_S,
    UNITS,
    crossing_peaks,
    detector,
    pooled,
    record,
)
from megalopta.sensor import Sensor
from megalopta.sensor.compare import CountedFrames, Difference, difference

Floats = NDArray[np.float64]

_PERIOD = 2 * FRAMES


class SpeedResponse(NamedTuple):
    """Peak responses of one detector at one speed, captured and simulated: crossings."""

    name: str
    speed_mm_s: float
    captured: Floats
    """(crossings,), mean over rows and detectors of the array."""
    simulated: Floats
    difference: Difference


def plate_responses(
    captured: Mapping[float, CountedFrames], device: Sensor, margin: float
) -> list[SpeedResponse]:
    """Compare responses to a plate at each speed (mm/s).

    Raises
    ------
    UserError
        When a recording is not of 16 × 16 pixels or shorter than two passages, 128 frames.
    """
    found = []
    for speed, frames in sorted(captured.items()):
        counts = _whole_passages(frames.counts, speed)
        simulated = record(speed, device).counts
        for name in TIME_CONSTANTS_S:
            a, b = (
                crossing_peaks(detector(name), pooled(each)).mean(axis=(1, 2))
                for each in (counts, simulated)
            )
            title = f"{name} response at {speed:g} mm/s"
            apart = difference(title, a, b, UNITS[name], margin)
            found.append(SpeedResponse(name, speed, a, b, apart))
    return found


def _whole_passages(counts: NDArray[np.floating], speed: float) -> NDArray[np.floating]:
    passages = len(counts) // _PERIOD
    if counts.shape[1:] != (PIXELS, PIXELS) or passages < 2:
        raise UserError(
            f"plate at {speed:g} mm/s: {len(counts)} frames of {counts.shape[1:]} pixels; capture "
            f"{2 * _PERIOD} frames of {PIXELS} × {PIXELS} or more"
        )
    return counts[: passages * _PERIOD]
