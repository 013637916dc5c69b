"""Quantities of an exposure: readings, their mean and variance, and streams of events.

Three quantities describe one scene on one device, averaged over temporal noise:

- photons on the pixel during the exposure, including its insensitive area;
- events: detections that reach the counter, after efficiency, dark counts, gate, dead time,
  afterpulsing and crosstalk; for an integrating sensor, collected electrons, including dark ones;
- reading: the output after the counter (capacity, step, leak, noise, ADC) or the rail.

**Event streams**: the time and place of every avalanche.

The histogram over the pixels agrees in distribution with the frames of `expose`. By default the
array is reset between frames. In a continuous array, dead times and trapped carriers carry over
from one frame to the next.

Source: dissertation §2.3.5.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Ints, Mask
from megalopta.core.compiling import compiled

Reals = NDArray[np.float32] | Floats


@dataclass(frozen=True, eq=False)
class Expectation:
    """Mean and variance of frames, each (T, H, W); float64, from a store float32."""

    photons: Reals
    """Mean number of photons on the pixel, equal to its variance."""
    mean_events: Reals
    events_variance: Reals
    """Moments of the detections that reach the counter (counts, counts²), or of collected
    electrons."""
    mean_reading: Reals
    reading_variance: Reals
    """Moments of `Exposure.counts`, in its unit and the square of it."""

    def signal_to_noise(self, brighter: "Expectation", by: float) -> Floats:
        """Signal from the light over the reading's standard deviation, (T, H, W).

        The signal follows from the slope of the reading at this light, as in EMVA 1288 (SNR
        referred to the exposure). It is near 0 where the pixel is saturated, negative where a
        paralyzable pixel reads less in more light, and 0 where readings never vary.

        `brighter`: expectation of the same sensor in light stronger by this fraction; `by`: much
        smaller than 1, such as 0.01.
        """
        signal = (np.asarray(brighter.mean_reading, np.float64) - self.mean_reading) / by
        noise = np.sqrt(np.asarray(self.reading_variance, np.float64))
        return np.divide(signal, noise, out=np.zeros_like(signal), where=noise > 0)


@dataclass(frozen=True, eq=False)
class Exposure:
    """Frames as read by the sensor."""

    counts: NDArray[np.uint16] | NDArray[np.uint32] | NDArray[np.float32]
    """(T, H, W): readings; unreliable where saturated. From an integrating sensor: electrons,
    float32."""
    saturated: Mask
    """(T, H, W): True where the pixel was saturated: the reading is a lower bound, or has
    wrapped."""
    expectation: Expectation | None = None
    """If requested."""


@dataclass(frozen=True, eq=False)
class Events:
    """Events of consecutive frames, sorted by frame and time stamp; 12 bytes each."""

    time_s: Floats
    """(N,): time stamp from the start of the event's frame, s."""
    pixel: NDArray[np.uint32]
    """(N,): row · columns + column."""
    starts: Ints
    """(frames + 1,): index of each frame's first event; N at the end."""
    shape: tuple[int, int, int]
    """(frames, rows, columns)"""
    first_frame: int = 0
    """Sequence number of the first frame."""
    value: Floats | None = None
    """(N,): of changes, the intensity that an event sends, detections per binary frame."""
    polarity: Mask | None = None
    """(N,): of contrast, True for ON; None for avalanches."""

    @property
    def frame(self) -> Ints:
        """Sequence number of each event's frame, (N,)."""
        frames = np.arange(self.first_frame, self.first_frame + self.shape[0])
        return np.repeat(frames, np.diff(self.starts))

    @property
    def row(self) -> Ints:
        """Row of each event, (N,)."""
        return self.pixel.astype(np.int64) // max(self.shape[2], 1)

    @property
    def column(self) -> Ints:
        """Column of each event, (N,)."""
        return self.pixel.astype(np.int64) % max(self.shape[2], 1)


def histogram(events: Events, frames: slice = slice(None)) -> Ints:
    """Events per pixel and frame, (frames, rows, columns); of contrast, ON minus OFF ones."""
    rows, columns = events.shape[1:]
    size, chosen = rows * columns, range(events.shape[0])[frames]
    counts = np.empty((len(chosen), size), np.int64)
    for net, frame in zip(counts, chosen, strict=True):
        inside = slice(events.starts[frame], events.starts[frame + 1])
        pixels = events.pixel[inside]
        net[:] = np.bincount(pixels, minlength=size)
        if events.polarity is not None:
            net -= 2 * np.bincount(pixels[~events.polarity[inside]], minlength=size)
    return counts.reshape(len(chosen), rows, columns)


def joined(
    streams: Sequence[tuple[Floats, NDArray[np.uint32]]],
    shape: tuple[int, int, int],
    first_frame: int,
    value: Floats | None = None,
) -> Events:
    """Return the events of frames from their times and pixels, in order."""
    starts = np.cumsum([0, *(times.size for times, _ in streams)], dtype=np.int64)
    times = np.concatenate([np.empty(0), *(times for times, _ in streams)])
    pixels = np.concatenate([np.empty(0, np.uint32), *(pixels for _, pixels in streams)])
    return Events(times, pixels, starts, shape, first_frame, value)


def in_order_of_time(stamps: Floats, pixels: Ints) -> tuple[Floats, NDArray[np.uint32]]:
    """Sort events by time; those of the same time keep their order.

    NumPy's unstable sort is four times as fast as its stable one, but orders equal times
    differently on different processors.
    """
    order = np.argsort(stamps)
    times, places = np.empty_like(stamps), np.empty(stamps.size, np.uint32)
    _gather(stamps, pixels, order, times, places)
    return times, places


@compiled
def _gather(
    stamps: Floats, pixels: Ints, order: Ints, times: Floats, places: NDArray[np.uint32]
) -> None:
    for rank in range(order.size):
        times[rank] = stamps[order[rank]]
        slot = rank
        while slot > 0 and times[slot - 1] == times[rank] and order[slot - 1] > order[slot]:
            order[slot - 1], order[slot] = order[slot], order[slot - 1]
            slot -= 1
    for rank in range(order.size):
        places[rank] = pixels[order[rank]]
