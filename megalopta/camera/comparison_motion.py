"""Responses of NDM and NDS to a moving plate, captured and simulated, and transfer functions."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.camera.motion_bench import (
    FRAME_RATE_HZ,
    PIXELS,
    TIME_CONSTANTS_S,
    UNITS,
    BenchLight,
    crossing_peaks,
    detector,
    pooled,
    record,
)
from megalopta.camera.passages import cut_passages, cut_rest, fitted_light
from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError
from megalopta.sensor import Sensor, changed
from megalopta.sensor.compare.quantities import CountedFrames
from megalopta.sensor.compare.two_sample import Difference, Quantity, difference


class SpeedResponse(NamedTuple):
    """Peak responses of one detector at one speed, captured and simulated: crossings."""

    name: str
    speed_mm_s: float
    captured: Floats
    """(crossings,), mean over rows and detectors of the array."""
    simulated: Floats
    difference: Difference


def plate_responses(
    captured: Mapping[float, CountedFrames],
    device: Sensor,
    margin: float,
    seed: int = 0,
    *,
    own_light: bool = False,
) -> list[SpeedResponse]:
    """Compare responses to a plate at each speed (mm/s), over whole passages of it.

    Passages are found by their edges, so that the plate may rest at its ends.

    Raises
    ------
    UserError
        When a recording is not of 16 × 16 pixels at 10 frames/s, or has fewer than two whole
        passages without a gap.
    """
    found = []
    for speed, frames in sorted(captured.items()):
        counts = _cut(speed, frames)
        own = changed(device, exposure_s=1 / FRAME_RATE_HZ)
        light = _light(speed, counts, own) if own_light else None
        simulated = record(speed, own, light, seed).counts
        for name in TIME_CONSTANTS_S:
            a, b = (
                crossing_peaks(detector(name), pooled(each)).mean(axis=(1, 2))
                for each in (counts, simulated)
            )
            title = f"{name} response at {speed:g} mm/s"
            apart = difference(Quantity(title, UNITS[name]), a, b, margin)
            found.append(SpeedResponse(name, speed, a, b, apart))
    return found


def _cut(speed: float, frames: CountedFrames) -> NDArray[Any]:
    if frames.counts.shape[1:] != (PIXELS, PIXELS):
        raise UserError(
            f"plate at {speed:g} mm/s: frames of {frames.counts.shape[1:]} pixels; capture all rows"
        )
    times_s = frames.times_s
    numbers = None if times_s is None else np.rint((times_s - times_s[0]) * FRAME_RATE_HZ)
    try:
        return cut_passages(frames.counts, numbers) if speed else cut_rest(frames.counts)
    except ValueError as problem:
        raise UserError(f"plate at {speed:g} mm/s: {problem}") from problem


def _light(speed: float, counts: NDArray[Any], device: Sensor) -> BenchLight:
    if speed == 0:
        raise UserError("a plate at rest does not tell the light; leave it out or --own-light")
    try:
        return fitted_light(counts, device)
    except ValueError as problem:
        raise UserError(f"plate at {speed:g} mm/s: {problem}") from problem
