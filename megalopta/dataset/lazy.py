"""Arrays whose frames are read, or drawn, when they are asked for."""

import operator
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

Index = int | slice | list[int] | NDArray[np.integer[Any]]


@dataclass(frozen=True, eq=False)
class LazyFrames:
    """An array (T, …) of which only the frames that are asked for are in memory.

        light[3], light[3:7], light[[0, 5]], light[3:7, 10:20, 10:20], numpy.asarray(light)

    Attributes
    ----------
    shape : tuple of int
    dtype : numpy.dtype
    unit : str
        What its numbers are.
    dimensions : tuple of str
        Names of its axes.
    read : callable
        From the numbers of frames (n,) to an array (n, …).
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    unit: str
    dimensions: tuple[str, ...]
    read: Callable[[list[int]], NDArray[Any]]

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return len(self.shape)

    def __len__(self) -> int:
        """Return the number of frames."""
        return self.shape[0]

    def __iter__(self) -> Iterator[NDArray[Any]]:
        """Yield frame after frame."""
        return (self[index] for index in range(len(self)))

    def __getitem__(self, index: Index | tuple[Any, ...]) -> NDArray[Any]:
        """Read frames; what follows the first index is taken of what was read."""
        first, rest = (index[0], index[1:]) if isinstance(index, tuple) else (index, ())
        if isinstance(first, slice):
            return self._frames(list(range(*first.indices(len(self)))))[(slice(None), *rest)]
        if isinstance(first, list | np.ndarray):
            chosen = np.arange(len(self))[np.asarray(first)].tolist()
            return self._frames(chosen)[(slice(None), *rest)]
        number = operator.index(first)
        if not -len(self) <= number < len(self):
            raise IndexError(f"frame {number} of {len(self)}")
        return np.asarray(self._frames([number % len(self)])[(0, *rest)])

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        """Read all of it."""
        return np.asarray(self[:], dtype=dtype)

    def _frames(self, numbers: list[int]) -> NDArray[Any]:
        if not numbers:
            return np.zeros((0, *self.shape[1:]), self.dtype)
        return self.read(numbers)


def frame_by_frame(read: Callable[[int], ArrayLike]) -> Callable[[list[int]], NDArray[Any]]:
    """What reads frames, of what reads one."""
    return lambda numbers: np.stack([np.asarray(read(number)) for number in numbers])
