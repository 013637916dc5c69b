"""Open HDF5 files for reading: the one place that does. Every folder may import this module.

A file may come from a stranger. Only arrays of plain numbers in the file itself are read: links,
virtual data, data in other files and filters of plug-ins are refused.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from megalopta.core.bounded import check_decoded, check_file

_FILTERS = {
    h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32,
    h5py.h5z.FILTER_LZF,
}  # fmt: skip
"""Filters that h5py has built in; HDF5 loads others from shared libraries."""


@contextmanager
def opened_hdf5(path: str | Path) -> Iterator[h5py.File]:
    """Yield an HDF5 file for `dataset_in`. Raises errors of any type, for `undamaged`."""
    check_file(path)
    with h5py.File(path, "r") as file:
        yield file


def is_in(file: h5py.File, name: str) -> bool:
    """Return whether a file itself holds something at a path, without following links."""
    place: Any = file
    for part in name.strip("/").split("/"):
        is_group = isinstance(place, h5py.Group)
        if not is_group or not isinstance(place.get(part, getlink=True), h5py.HardLink):
            return False
        place = place[part]
    return True


def dataset_in(
    file: h5py.File, name: str, kinds: str, axes: int, bytes_each: float
) -> h5py.Dataset:
    """Return an array of a file that may be read.

    `kinds` are its possible kinds of numbers (`numpy.dtype.kind`); `bytes_each` are the bytes of a
    value in memory, copies of the reader included. Raises ValueError if there is no such array;
    UserError if it takes too much memory.
    """
    if not is_in(file, name):
        raise ValueError(f"{name} is missing, or a link")
    data = file[name]
    if not isinstance(data, h5py.Dataset) or data.is_virtual or data.external:
        raise ValueError(f"{name} is no array of this file")
    if data.shape is None or data.ndim != axes or data.dtype.kind not in kinds:
        raise ValueError(f"{name} is {data.dtype} {data.shape}")
    created = data.id.get_create_plist()
    filters = {created.get_filter(number)[0] for number in range(created.get_nfilters())}
    if strange := filters - _FILTERS:
        raise ValueError(f"{name} needs a filter that is not built in (number {min(strange)})")
    for shape in (data.shape, data.chunks or ()):
        check_decoded(file.filename, shape, max(bytes_each, data.dtype.itemsize))
    return data


def numbers_in(
    file: h5py.File, name: str, kinds: str, axes: int, bytes_each: float = 16
) -> NDArray[Any]:
    """Read an array of a file; as `dataset_in`."""
    return np.asarray(dataset_in(file, name, kinds, axes, bytes_each)[()])
