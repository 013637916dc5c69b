"""Arrays in memory that earlier ones have left.

A system clears the memory that it hands out, which takes as long as drawing photons into it.
"""

import math
import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray


class ReusedMemory(threading.local):
    """Memory of one thread, all of which is free again at `release`."""

    def __init__(self) -> None:
        self._free: list[NDArray[np.uint8]] = []
        self._taken: list[NDArray[np.uint8]] = []

    def empty(self, shape: tuple[int, ...], kind: type[np.generic]) -> NDArray[Any]:
        """Return an array as `numpy.empty` does, not to be used after `release`."""
        size = math.prod(shape) * np.dtype(kind).itemsize
        place = next((k for k, block in enumerate(self._free) if block.size >= size), None)
        block = np.empty(size, np.uint8) if place is None else self._free.pop(place)
        self._taken.append(block)
        return block[:size].view(kind).reshape(shape)

    def release(self) -> None:
        """Take back all arrays."""
        self._free += self._taken
        self._taken = []
