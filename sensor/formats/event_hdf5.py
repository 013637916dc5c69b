"""Event streams in HDF5, in the layout that event cameras' data sets have.

Group `events` with `t`, `x`, `y` and `p` (`event_stream`); `p` is 1 for every event and takes no
room, as nothing but its fill value is written. `frame_start` holds the number of the first event of
each frame. What the frames were stands in the attributes of the file. Checksums of data (Fletcher)
and of structure (HDF5 1.10) betray damage.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np
from numpy.typing import NDArray

from megalopta.core.files import atomic_write
from megalopta.sensor.events import Events
from megalopta.sensor.formats.event_stream import (
    EventOrigin,
    StoredEvents,
    check_frames,
    columns_of,
    damage_told,
    stored_events,
)
from megalopta.sensor.formats.recorded_frames import file_bytes

HDF5_SIGNATURE: Final = b"\x89HDF\r\n\x1a\n"

_FORMAT = "megalopta events"
_CHUNK = 16384
_TYPES = {"t": "<i8", "x": "<u2", "y": "<u2", "p": "|u1"}
_UNITS = {"t": "ps", "x": "column", "y": "row", "p": "1: an avalanche"}


def write_events_hdf5(path: str | Path, events: Events, origin: EventOrigin) -> None:
    """Write events as one file."""
    with events_hdf5_writer(path, origin) as write:
        write(events)


@contextmanager
def events_hdf5_writer(path: str | Path, origin: EventOrigin) -> Iterator[Callable[[Events], None]]:
    """Yield what appends events of the next frames; the file appears when all are there.

    Raises
    ------
    ValueError
        When the events are of other frames than the origin says.
    """
    with (
        atomic_write(Path(path)) as temporary,
        h5py.File(temporary, "w", libver=("v110", "latest")) as file,
    ):
        file.attrs.update({"format": _FORMAT} | origin.attributes())
        columns = {name: _column(file, name) for name in _TYPES}
        starts = [0]

        def write(events: Events) -> None:
            begin = starts[-1]
            _append(columns, begin, *columns_of(events, origin))
            starts.extend((begin + events.starts[1:]).tolist())

        yield write
        check_frames(path, len(starts) - 1, origin)
        columns["p"].resize((starts[-1],))
        start = file.create_dataset("frame_start", data=np.array(starts, "<i8"), fletcher32=True)
        start.attrs["unit"] = "number of a frame's first event"


def read_events_hdf5(path: str | Path) -> StoredEvents:
    """Read a file that `write_events_hdf5` wrote.

    Raises
    ------
    FileNotFoundError
        When there is nothing.
    ValueError
        When it is something else, damaged or cut short.
    """
    path = Path(path)
    size = file_bytes(path).size
    with damage_told(path), h5py.File(path, "r") as file:
        attributes = dict(file.attrs)
        if attributes.get("format") != _FORMAT:
            raise ValueError("no events as megalopta writes them")
        t, x, y = (_read(file, f"events/{name}", _TYPES[name], size) for name in "txy")
        starts = _read(file, "frame_start", "<i8", size)
    return stored_events(path, attributes, t, x, y, starts)


def _column(file: h5py.File, name: str) -> h5py.Dataset:
    found = file.create_dataset(
        f"events/{name}", (0,), _TYPES[name], maxshape=(None,), chunks=(_CHUNK,),
        fletcher32=name != "p", fillvalue=int(name == "p"),
    )  # fmt: skip
    found.attrs["unit"] = _UNITS[name]
    return found


def _append(
    columns: dict[str, h5py.Dataset],
    begin: int,
    t: NDArray[np.int64],
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
) -> None:
    for name, values in (("t", t), ("x", x), ("y", y)):
        columns[name].resize((begin + len(values),))
        columns[name][begin:] = values


def _read(file: h5py.File, name: str, dtype: str, size: int) -> NDArray[Any]:
    """Numbers of a file, if they are in it, of their type and no more than it can hold."""
    if not isinstance(file.get(name, getlink=True), h5py.HardLink):
        raise ValueError(f"{name} is missing, or in another file")
    found = file[name]
    if not isinstance(found, h5py.Dataset) or found.is_virtual or found.external:
        raise ValueError(f"{name} is no array of this file")
    if found.dtype != np.dtype(dtype) or found.ndim != 1:
        raise ValueError(f"{name} is {found.dtype} {found.shape}")
    if found.nbytes > size:
        raise ValueError(f"{name} has {found.nbytes} bytes in a file of {size}")
    return np.asarray(found[...])
