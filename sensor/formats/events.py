"""Event streams in HDF5, in the layout of event-camera data sets, and in `.npz`.

Layout: `docs/file-formats.md`.
"""

import json
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, TypeAlias

import h5py
import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Ints
from megalopta.core.bounded import check_decoded, numbers_in, opened_hdf5, undamaged, zipped_arrays
from megalopta.core.files import atomic_write
from megalopta.core.format_numbers import FORMATS, check_format
from megalopta.sensor.quantities import Events

Column: TypeAlias = NDArray[np.integer[Any]]

HDF5_SIGNATURE: Final = b"\x89HDF\r\n\x1a\n"
NPZ_SIGNATURE: Final = b"PK\x03\x04"
MOST_PIXELS_A_SIDE = 65536

_PICOSECONDS = 1e12
_NUMBERS = ("frames", "height", "width", "first_frame", "frame_period_ps")
_TYPES = {"t": "<i8", "x": "<u2", "y": "<u2"}
_FORMAT = "megalopta events"
_CHUNK = 16384
_UNITS = {"t": "ps", "x": "column", "y": "row", "p": "1: an avalanche"}
_EVENT_BYTES, _DECODED_BYTES = 12, 64
"""Bytes of an event in a file, and of what its reader makes of it"""


@dataclass(frozen=True, kw_only=True)
class EventOrigin:
    """Frames to which the events of a file belong."""

    shape: tuple[int, int, int]
    """Frames, rows, columns"""
    frame_period_s: float
    """Time between the starts of consecutive frames, s; rounded to a picosecond"""
    exposure_s: float
    """Exposure time of a frame, s"""
    first_frame: int = 0
    """Sequence number of the first frame"""
    extra: Mapping[str, Any] = field(default_factory=dict)
    """Further notes of the writer; JSON values"""

    @property
    def frame_starts_ps(self) -> Ints:
        """Start of each frame, (T,), picoseconds."""
        return self._period_ps * (self.first_frame + np.arange(self.shape[0], dtype=np.int64))

    @property
    def _period_ps(self) -> int:
        return round(self.frame_period_s * _PICOSECONDS)

    def attributes(self) -> dict[str, Any]:
        """Return the description of a file's frames."""
        return {
            "version": FORMATS["events"].written,
            **dict(zip(_NUMBERS, (*self.shape, self.first_frame, self._period_ps), strict=True)),
            "exposure_s": self.exposure_s,
            "extra": json.dumps(dict(self.extra)),
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class StoredEvents:
    """Events of a file with the frames to which they belong."""

    events: Events
    origin: EventOrigin


def write_events_hdf5(path: str | Path, events: Events, origin: EventOrigin) -> None:
    """Write events to one file."""
    with events_hdf5_writer(path, origin) as write:
        write(events)


def write_events_npz(path: str | Path, events: Events, origin: EventOrigin) -> None:
    """Write events to one file."""
    with events_npz_writer(path, origin) as write:
        write(events)


@contextmanager
def events_hdf5_writer(path: str | Path, origin: EventOrigin) -> Iterator[Callable[[Events], None]]:
    """Yield a function that appends the next frames' events; the file appears once complete.

    Raises ValueError if the events' frames differ from those of the origin.
    """
    with (
        atomic_write(Path(path)) as temporary,
        h5py.File(temporary, "w", libver=("v110", "latest")) as file,
    ):
        file.attrs.update({"format": _FORMAT} | origin.attributes())
        columns = {name: _dataset(file, name, type_) for name, type_ in _TYPES.items()}
        ones = _dataset(file, "p", "|u1")
        with _appending(path, origin) as (starts, columns_of):

            def write(events: Events) -> None:
                for name, values in columns_of(events).items():
                    columns[name].resize((starts[-1],))
                    columns[name][starts[-1] - len(values) :] = values

            yield write
        ones.resize((starts[-1],))
        start = file.create_dataset("frame_start", data=np.array(starts, "<i8"), fletcher32=True)
        start.attrs["unit"] = "index of a frame's first event"


@contextmanager
def events_npz_writer(path: str | Path, origin: EventOrigin) -> Iterator[Callable[[Events], None]]:
    """Yield a function that appends the next frames' events; the file appears once complete.

    Events wait in memory, 12 bytes each, as their number precedes them. Raises ValueError if their
    frames differ from those of the origin.
    """
    blocks: dict[str, list[Column]] = {name: [np.empty(0, kind)] for name, kind in _TYPES.items()}
    with _appending(path, origin) as (starts, columns_of):

        def write(events: Events) -> None:
            for name, values in columns_of(events).items():
                blocks[name].append(values)

        yield write
    text = json.dumps(origin.attributes()).encode()
    with atomic_write(Path(path)) as temporary, zipfile.ZipFile(temporary, "w") as file:
        for name in (*_TYPES, "starts", "origin"):
            array: NDArray[Any] = np.array(starts, "<i8")
            if name in blocks:
                array = np.concatenate(blocks.pop(name))
            elif name == "origin":
                array = np.frombuffer(text, np.uint8)
            # a fixed date, so that equal events give equal bytes
            with file.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as member:
                np.lib.format.write_array(member, array, allow_pickle=False)


def read_events_hdf5(path: Path) -> StoredEvents:
    """Read a file written by `write_events_hdf5`; raises as `read_events`."""
    with undamaged(path), opened_hdf5(path) as file:
        attributes = dict(file.attrs)
        if attributes.get("format") != _FORMAT:
            raise ValueError("no events in megalopta's layout")
        columns = {
            name: numbers_in(file, f"events/{name}", "iu", 1, _DECODED_BYTES) for name in _TYPES
        }
        starts = numbers_in(file, "frame_start", "i", 1)
    return _stored(path, attributes, columns, starts)


def read_events_npz(path: Path) -> StoredEvents:
    """Read a file written by `write_events_npz`; raises as `read_events`."""
    check_decoded(path, (path.stat().st_size // _EVENT_BYTES,), _DECODED_BYTES)
    with undamaged(path):
        arrays = zipped_arrays(path, (*_TYPES, "starts", "origin"))
        attributes = dict(json.loads(arrays["origin"].tobytes()))
    columns, starts = {name: arrays[name] for name in _TYPES}, arrays["starts"]
    return _stored(path, attributes, columns, starts)


@contextmanager
def _appending(
    path: str | Path, origin: EventOrigin
) -> Iterator[tuple[list[int], Callable[[Events], dict[str, Column]]]]:
    """Yield the starts so far, and a function that adds events and returns their columns."""
    starts = [0]

    def columns_of(events: Events) -> dict[str, Column]:
        begin = events.first_frame - origin.first_frame
        last, end = begin + events.shape[0], origin.shape[0]
        if events.shape[1:] != origin.shape[1:] or not 0 <= begin <= end:
            raise ValueError(
                f"events of frames {events.first_frame} to {origin.first_frame + last - 1}, "
                f"{events.shape[1:]} pixels; the file is for {origin.first_frame} to "
                f"{origin.first_frame + end - 1}, {origin.shape[1:]} pixels"
            )
        if max(origin.shape[1:]) > MOST_PIXELS_A_SIDE:
            raise ValueError(f"{origin.shape[1:]} pixels; an event file has up to 65536 a side")
        t = np.rint(events.time_s * _PICOSECONDS).astype(np.int64)
        t += np.repeat(origin.frame_starts_ps[begin:last], np.diff(events.starts))
        width = np.uint32(max(origin.shape[2], 1))
        y = events.pixel // width
        x = events.pixel - y * width
        starts.extend((starts[-1] + events.starts[1:]).tolist())
        return {"t": t, "x": x.astype(np.uint16), "y": y.astype(np.uint16)}

    yield starts, columns_of
    if len(starts) - 1 != origin.shape[0]:
        raise ValueError(f"{path}: {len(starts) - 1} frames were written of {origin.shape[0]}")


def _stored(
    path: Path, attributes: Mapping[str, Any], columns: Mapping[str, Column], starts: Column
) -> StoredEvents:
    """Events from the arrays of a file; ValueError if these are inconsistent."""
    with undamaged(path):
        version = int(attributes.get("version", 0))
        check_format("events", {"version": version}, path, key="version")
        frames, height, width, first_frame, period_ps = (int(attributes[name]) for name in _NUMBERS)
        exposure_s = float(attributes["exposure_s"])
        if min(frames, height, width, first_frame, period_ps) < 0 or not exposure_s > 0:
            raise ValueError(
                f"{frames} frames of {height} × {width} pixels, exposed {exposure_s} s"
            )
        origin = EventOrigin(
            shape=(frames, height, width),
            frame_period_s=period_ps / _PICOSECONDS,
            exposure_s=exposure_s,
            first_frame=first_frame,
            extra=dict(json.loads(attributes["extra"])),
        )
        for key, column in {**columns, "starts": starts}.items():
            if column.dtype != np.dtype(_TYPES.get(key, "<i8")) or column.ndim != 1:
                raise ValueError(f"{key} is {column.dtype} {column.shape}")
        t, x, y = columns["t"], columns["x"], columns["y"]
        if not len(t) == len(x) == len(y):
            raise ValueError(f"{len(t)} times, {len(x)} columns and {len(y)} rows")
        if len(starts) != frames + 1 or starts[0] != 0 or starts[-1] != len(t):
            raise ValueError(f"starts do not share {len(t)} events among {frames} frames")
        if np.any(np.diff(starts) < 0):
            raise ValueError("starts decrease")
        if t.size and (x.max() >= width or y.max() >= height):
            raise ValueError(f"a pixel outside of {height} × {width}")
        backward = np.flatnonzero(np.diff(t) < 0) + 1
        if not np.isin(backward, starts).all():
            raise ValueError("times that decrease within a frame")
    time_s = (t - np.repeat(origin.frame_starts_ps, np.diff(starts))) / _PICOSECONDS
    pixel = np.asarray(y.astype(np.uint32) * np.uint32(width) + x, np.uint32)
    events = Events(time_s, pixel, starts.astype(np.int64), origin.shape, first_frame)
    return StoredEvents(events=events, origin=origin)


def _dataset(file: h5py.File, name: str, dtype: str) -> h5py.Dataset:
    dataset = file.create_dataset(
        f"events/{name}", (0,), dtype, maxshape=(None,), chunks=(_CHUNK,),
        fletcher32=name != "p", fillvalue=int(name == "p"),
    )  # fmt: skip
    dataset.attrs["unit"] = _UNITS[name]
    return dataset
