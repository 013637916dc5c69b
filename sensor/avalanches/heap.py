"""Heap of the arrivals that may fire a pixel, earliest first, in two arrays: times and owners."""

import numpy as np

from megalopta.core.compiling import compiled


@compiled
def push(times, owners, size, time, owner):  # type: ignore[no-untyped-def]
    """Add an entry to the heap and return its new size."""
    place = size
    while place > 0 and times[(place - 1) // 2] > time:
        parent = (place - 1) // 2
        times[place], owners[place] = times[parent], owners[parent]
        place = parent
    times[place], owners[place] = time, owner
    return size + 1


@compiled
def pop(times, owners, size):  # type: ignore[no-untyped-def]
    """Remove the first entry of the heap and return its new size."""
    size -= 1
    time, owner = times[size], owners[size]
    place, child = 0, 1
    while child < size:
        if child + 1 < size and times[child + 1] < times[child]:
            child += 1
        if times[child] >= time:
            break
        times[place], owners[place] = times[child], owners[child]
        place, child = child, 2 * child + 1
    times[place], owners[place] = time, owner
    return size


@compiled
def longer(values, spare):  # type: ignore[no-untyped-def]
    """Return a copy of an array, of twice the length and `spare` more."""
    result = np.empty(2 * values.size + spare, values.dtype)
    # compiles in a tenth of the time of an assignment to a slice
    for place in range(values.size):
        result[place] = values[place]
    return result
