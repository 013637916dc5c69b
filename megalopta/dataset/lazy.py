"""Arrays whose frames are read, or drawn, when they are asked for; and as xarray shows them."""

import operator
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from megalopta.core.errors import UserError

if TYPE_CHECKING:
    import xarray

    from megalopta.dataset.sequence import Sequence

Index = int | slice | list[int] | NDArray[np.integer[Any]]


@dataclass(frozen=True, eq=False)
class LazyFrames:
    """An array (T, …) of which only the frames that are asked for are in memory.

    light[3], light[3:7], light[[0, 5]], light[3:7, 10:20, 10:20], numpy.asarray(light)
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    unit: str
    """What its numbers are"""
    dimensions: tuple[str, ...]
    """Names of its axes"""
    read: Callable[[list[int]], NDArray[Any]]
    """From the numbers of frames (n,) to an array (n, …)"""

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return len(self.shape)

    def __len__(self) -> int:
        """Return the number of frames."""
        return self.shape[0]

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


def labeled(sequence: "Sequence", exposures: Iterable[str]) -> "xarray.Dataset":
    """Return a lazy xarray.Dataset of a sequence. Raises UserError without xarray."""
    try:
        import xarray
    except ImportError:
        raise UserError("xarray is not installed; run: pip install xarray") from None

    arrays = {"radiance": sequence.radiance, "depth": sequence.depth, "flow": _flows(sequence)}
    for name in exposures:
        arrays[f"counts {name}" if len(sequence.exposures) > 1 else "counts"] = sequence.counts(
            name
        )
    variables = {name: _variable(xarray, array) for name, array in arrays.items()}
    poses = xarray.Variable(("frame", "to", "from"), sequence.poses, {"units": "m"})
    return xarray.Dataset(
        {**variables, "camera_to_world": poses},
        coords={
            "time": ("frame", sequence.times_s, {"units": "s"}),
            "band_nm": ("band", np.mean(sequence.bands_nm, axis=1), {"units": "nm"}),
            "component": ["x", "y"],
        },
        attrs={"sequence": sequence.name, "split": sequence.split},
    )


def _flows(sequence: "Sequence") -> LazyFrames:
    """Forward flow of every frame; that of the last is unknown."""

    def read(index: int) -> Any:
        if index + 1 < len(sequence):
            return sequence.flow(index)
        return np.full((*sequence.shape, 2), np.nan, np.float32)

    shape = (len(sequence), *sequence.shape, 2)
    dimensions = ("frame", "row", "column", "component")
    return LazyFrames(shape, np.dtype(np.float32), "px", dimensions, frame_by_frame(read))


def _variable(xarray: Any, array: LazyFrames) -> Any:
    import dask.array

    chunks = (1, *array.shape[1:])
    lazy = dask.array.from_array(array, chunks=chunks, name=False, asarray=False)
    return xarray.Variable(array.dimensions, lazy, {"units": array.unit})
