"""Event streams: the time and place of every avalanche.

The histogram over the pixels agrees in distribution with the frames of `expose`. By default the
array is reset between frames. In a continuous array, dead times and trapped carriers carry over
from one frame to the next.

Source: dissertation §2.3.5.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Ints
from megalopta.core.compiling import compiled


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


def histogram(events: Events) -> Ints:
    """Events per pixel and frame, (frames, rows, columns)."""
    frames, rows, columns = events.shape
    counts = np.empty((frames, rows * columns), np.int64)
    for frame in range(frames):
        pixels = events.pixel[events.starts[frame] : events.starts[frame + 1]]
        counts[frame] = np.bincount(pixels, minlength=rows * columns)
    return counts.reshape(events.shape)


def joined(
    streams: Sequence[tuple[Floats, NDArray[np.uint32]]],
    shape: tuple[int, int, int],
    first_frame: int,
) -> Events:
    """Return the events of frames from their times and pixels, in order."""
    starts = np.cumsum([0, *(times.size for times, _ in streams)], dtype=np.int64)
    times = np.concatenate([np.empty(0), *(times for times, _ in streams)])
    pixels = np.concatenate([np.empty(0, np.uint32), *(pixels for _, pixels in streams)])
    return Events(times, pixels, starts, shape, first_frame)


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
    stamps: Floats,
    pixels: Ints,
    order: Ints,
    times: Floats,
    places: NDArray[np.uint32],
) -> None:
    for rank in range(order.size):
        times[rank] = stamps[order[rank]]
        slot = rank
        while slot > 0 and times[slot - 1] == times[rank] and order[slot - 1] > order[slot]:
            order[slot - 1], order[slot] = order[slot], order[slot - 1]
            slot -= 1
    for rank in range(order.size):
        places[rank] = pixels[order[rank]]
