"""Frames of an array that is not reset between them.

Counts, events and binary frames of such an array are drawn from one set of random streams: the same
seed, sequence and frames make the same avalanches. What its frames are on average is stated for
pixels that have run in the light of the frame for long (`RUNNING_ERROR`). A gate's windows begin
anew with every frame.
"""

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.sensor.avalanches.running import FreeRunning
from megalopta.sensor.avalanches.simulation import SimulatedFrame
from megalopta.sensor.change import changed
from megalopta.sensor.effects.dead_time import check_arrivals
from megalopta.sensor.sampling.streams import generator
from megalopta.sensor.spad.fixed_pattern import FixedPattern
from megalopta.sensor.spad.model import Sensor

RUNNING_ERROR = (
    "stated for pixels that have run in the light of the frame for long; where light changes "
    "between frames, and in the first, mean_events are off by at most one count, times the share "
    "of time dead; with afterpulsing by as much over one less mean_carriers, and the carriers that "
    "wait; exact without either"
)
"""What the moments of events of an array that runs freely are off by."""


def running_frame(
    array: FreeRunning,
    rng: np.random.Generator,
    detections_hz: Floats,
    sensor: Sensor,
    device: FixedPattern,
    *,
    keep_events: bool = True,
) -> SimulatedFrame:
    """Simulate the next exposure of an array, of rates (H, W) or (S, H, W) without dark counts."""
    arrivals_hz = detections_hz + device.dark_counts_hz
    check_arrivals(arrivals_hz, sensor.exposure_s)
    return array.expose(
        rng,
        arrivals_hz,
        sensor.exposure_s,
        sensor.avalanche_effects,
        device.avalanches,
        keep_events=keep_events,
    )


def running_counts(
    array: FreeRunning,
    detections_hz: Floats,
    sensor: Sensor,
    device: FixedPattern,
    seed: int,
    key: tuple[str | int, int],
) -> NDArray[np.int64]:
    """Number the events (rows, columns) of the next exposure; the key is sequence and frame."""
    rng = generator(seed, "events", *key)
    return running_frame(array, rng, detections_hz, sensor, device, keep_events=False).counts


def settled(sensor: Sensor) -> Sensor:
    """Return the sensor whose pixels have been running for long when an exposure starts."""
    return changed(sensor, dead_time={"start": "stationary"})
