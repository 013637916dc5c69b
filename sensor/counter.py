"""The counter in the pixel: it holds so many events and no more.

A digital counter that stops at its capacity, or an analog one whose output has reached the end of
its swing. A reading at capacity may stand for any larger number, so it is flagged.
"""

import numpy as np
from numpy.typing import NDArray

LARGEST_CAPACITY = 2**32 - 1
"""Counts are stored in at most 32 bits."""

Counts = NDArray[np.uint16] | NDArray[np.uint32]


def read_counter(events: NDArray[np.int64], capacity: int) -> tuple[Counts, NDArray[np.bool_]]:
    """Read counters that have seen so many events.

    Parameters
    ----------
    events : integer array
    capacity : int
        The largest count a counter can hold.

    Returns
    -------
    counts : uint16 or uint32 array
        The smaller type that holds the capacity.
    saturated : bool array
        Where the counter is full: the count is a lower bound.
    """
    held = np.minimum(events, capacity)
    fits_16_bits = capacity <= np.iinfo(np.uint16).max
    counts: Counts = held.astype(np.uint16) if fits_16_bits else held.astype(np.uint32)
    return counts, events >= capacity
