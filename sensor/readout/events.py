"""Event streams: the time and place of every avalanche, instead of counts.

The same device under the same light as in `exposure`, without the counter: an event-based array
reports every avalanche. The histogram over the pixels agrees in distribution with the frames, not
count by count, as the draws are others. Each exposure starts as a frame does, so the stream is that
of an array which is reset between frames; choose a stationary start where it runs through.

Source: dissertation §2.3.2 (jitter), §2.3.5.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from megalopta.sensor.avalanches import simulate_events
from megalopta.sensor.effects import check_arrivals, stamp
from megalopta.sensor.sampling import generator
from megalopta.sensor.spad import Sensor, checked_rate, over_frames


@dataclass(frozen=True, eq=False)
class Events:
    """Events of consecutive frames, sorted by frame and time stamp.

    Attributes
    ----------
    frame : (N,) int64
        Number in the sequence of the frame that the avalanche belongs to.
    time_s : (N,) float64
        Time stamp from the start of that frame's exposure, s.
    row, column : (N,) int64
        The pixel.
    shape : (frames, rows, columns)
    first_frame : int
        Number in the sequence of the first frame.
    """

    frame: NDArray[np.int64]
    time_s: NDArray[np.float64]
    row: NDArray[np.int64]
    column: NDArray[np.int64]
    shape: tuple[int, int, int]
    first_frame: int = 0


def expose_events(
    detections_hz: ArrayLike,
    sensor: Sensor,
    *,
    seed: int,
    sequence: str | int,
    first_frame: int = 0,
    threads: int | None = None,
) -> Events:
    """Draw the events of frames whose detection rate is known, (T, H, W) in Hz.

    Parameters and errors are those of `expose_rate`; `detection_rate` gives the rate of a scene.
    """
    rate, device = checked_rate(detections_hz, sensor)
    streams: list[tuple[NDArray[np.float64], NDArray[np.int64]]] = [None] * len(rate)  # type: ignore[list-item]

    def expose_frame(frame: int) -> None:
        arrivals_hz = rate[frame] + device.dark_counts_hz
        check_arrivals(arrivals_hz, sensor.exposure_s)
        rng = generator(seed, "events", sequence, first_frame + frame)
        times, pixels = simulate_events(
            rng, arrivals_hz, sensor.exposure_s, sensor.avalanche_effects, device.avalanches
        )
        stamps = stamp(rng, times, sensor.jitter)
        order = np.argsort(stamps, kind="stable")
        streams[frame] = stamps[order], pixels[order]

    over_frames(expose_frame, len(rate), threads)
    return _joined(streams, rate.shape, first_frame)


def histogram(events: Events) -> NDArray[np.int64]:
    """Events per pixel and frame, (frames, rows, columns)."""
    _, rows, columns = events.shape
    flat = ((events.frame - events.first_frame) * rows + events.row) * columns + events.column
    return np.bincount(flat, minlength=int(np.prod(events.shape))).reshape(events.shape)


def _joined(
    streams: list[tuple[NDArray[np.float64], NDArray[np.int64]]],
    shape: tuple[int, ...],
    first_frame: int,
) -> Events:
    frames, rows, columns = shape
    lengths = [times.size for times, _ in streams]
    times = np.concatenate([np.empty(0), *(times for times, _ in streams)])
    pixels = np.concatenate([np.empty(0, np.int64), *(pixels for _, pixels in streams)])
    row, column = np.divmod(pixels, max(columns, 1))
    frame = np.repeat(np.arange(first_frame, first_frame + frames), lengths)
    return Events(frame, times, row, column, (frames, rows, columns), first_frame)
