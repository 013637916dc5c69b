"""Event streams in HDF5, in the layout of event-camera data sets.

Layout: `docs/reference/recorded-files.md`.
"""

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np

from megalopta.core.arrays import Ints
from megalopta.core.bounded import is_in, numbers_in, opened_hdf5, undamaged
from megalopta.core.files import atomic_write
from megalopta.core.format_numbers import FORMATS, check_format
from megalopta.sensor.formats.recorded_frames import file_bytes
from megalopta.sensor.quantities import Events

HDF5_SIGNATURE: Final = b"\x89HDF\r\n\x1a\n"

_PICOSECONDS = 1e12
_NUMBERS = ("frames", "height", "width", "first_frame", "frame_period_ps")
_TYPES = {"t": "<i8", "x": "<u2", "y": "<u2"}
_VALUED = _TYPES | {"value": "<f4"}
_FORMAT = "megalopta events"
_UNITS = {"t": "ps", "x": "column", "y": "row", "p": "1: an avalanche", "value": "per binary frame"}
_POLARITY = "1: ON, 0: OFF"
_PS_PER_US = 10**6


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
        return self.period_ps * (self.first_frame + np.arange(self.shape[0], dtype=np.int64))

    @property
    def period_ps(self) -> int:
        """Time between the starts of consecutive frames, ps."""
        return round(self.frame_period_s * _PICOSECONDS)


@dataclass(frozen=True, eq=False, kw_only=True)
class StoredEvents:
    """Events of a file with the frames to which they belong."""

    events: Events
    origin: EventOrigin


def write_events_hdf5(path: str | Path, events: Events, origin: EventOrigin) -> None:
    """Write events to one file."""
    with events_hdf5_writer(path, origin) as write:
        write(events)


@contextmanager
def events_hdf5_writer(
    path: str | Path, origin: EventOrigin, *, has_values: bool = False, is_dsec: bool = False
) -> Iterator[Callable[[Events], None]]:
    """Yield a function that appends the next frames' events; the file appears once complete.

    `has_values`: they are changes, each with a value; `is_dsec`: times as DSEC has them, 32 bits of
    µs from `t_offset`, never falling, with the first event of every ms in `ms_to_idx`. Raises
    ValueError if the events' frames differ from those of the origin, or take too long for 32 bits.
    """
    if max(origin.shape[1:]) > 2**16:
        raise ValueError(f"{origin.shape[1:]} pixels; an event file has up to 65536 a side")
    types = _VALUED if has_values else _TYPES | {"p": "|u1"}
    types = types | ({"t": "<u4"} if is_dsec else {})
    offset_us = origin.first_frame * origin.period_ps // _PS_PER_US
    end_us = (origin.first_frame + origin.shape[0]) * origin.period_ps // _PS_PER_US
    if is_dsec and end_us - offset_us >= 2**32 - 10**6:
        raise ValueError(f"{path}: DSEC's times end at 4293 s, use fewer frames")
    with (
        atomic_write(Path(path)) as temporary,
        h5py.File(temporary, "w", libver=("v110", "latest")) as file,
    ):
        numbers = *origin.shape, origin.first_frame, origin.period_ps
        attributes = {
            "format": _FORMAT,
            "version": FORMATS["events"].written,
            **dict(zip(_NUMBERS, numbers, strict=True)),
            "exposure_s": origin.exposure_s,
            "extra": json.dumps(dict(origin.extra)),
        }
        file.attrs.update(attributes | ({"has_values": True} if has_values else {}))
        columns = {name: _dataset(file, name, type_) for name, type_ in types.items()}
        starts, last_us = [0], 0

        def write(events: Events) -> None:
            nonlocal last_us
            begin = events.first_frame - origin.first_frame
            last, end = begin + events.shape[0], origin.shape[0]
            if events.shape[1:] != origin.shape[1:] or not 0 <= begin <= end:
                raise ValueError(
                    f"events of frames {events.first_frame} to {origin.first_frame + last - 1}, "
                    f"{events.shape[1:]} pixels; the file is for {origin.first_frame} to "
                    f"{origin.first_frame + end - 1}, {origin.shape[1:]} pixels"
                )
            t = np.rint(events.time_s * _PICOSECONDS).astype(np.int64)
            t += np.repeat(origin.frame_starts_ps[begin:last], np.diff(events.starts))
            if is_dsec:
                us = np.rint(t / _PS_PER_US).astype(np.int64) - offset_us
                t = np.maximum(np.maximum.accumulate(us), last_us)
                last_us = max(last_us, t.max(initial=0))
            y, x = np.divmod(events.pixel, np.uint32(max(origin.shape[2], 1)))
            values = {"t": t, "x": x, "y": y, "value": events.value, "p": events.polarity}
            starts.extend((starts[-1] + events.starts[1:]).tolist())
            for name, of_events in values.items():
                if of_events is not None:
                    columns[name].resize((starts[-1],))
                    columns[name][starts[-1] - len(of_events) :] = of_events
            if events.polarity is not None:
                columns["p"].attrs["unit"] = _POLARITY

        yield write
        if len(starts) - 1 != origin.shape[0]:
            raise ValueError(f"{path}: {len(starts) - 1} frames were written of {origin.shape[0]}")
        columns["value" if has_values else "p"].resize((starts[-1],))  # p of avalanches: all ones
        if is_dsec:
            columns["t"].attrs["unit"] = "µs from t_offset"
            every_ms = np.arange(0, max(end_us - offset_us, last_us) + 1000, 1000)
            first = np.searchsorted(columns["t"][()], every_ms).astype(np.uint64)
            file.create_dataset("ms_to_idx", data=first, fletcher32=True)
            file.create_dataset("t_offset", data=np.int64(offset_us))
        start = file.create_dataset("frame_start", data=np.array(starts, "<i8"), fletcher32=True)
        start.attrs["unit"] = "index of a frame's first event"


def read_events(path: str | Path) -> StoredEvents:
    """Read a file of events written by megalopta.

    Raises FileNotFoundError if the path does not exist; ValueError if the file is of another
    format, damaged or truncated.
    """
    path = Path(path)
    if file_bytes(path)[:8].tobytes() != HDF5_SIGNATURE:
        raise ValueError(f"{path}: no events; give an HDF5 file written by megalopta")
    with undamaged(path), opened_hdf5(path) as file:
        attributes = dict(file.attrs)
        if attributes.get("format") != _FORMAT:
            raise ValueError("no events in megalopta's layout")
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
        types = dict(_VALUED if attributes.get("has_values") else _TYPES)
        if is_in(file, "events/p") and file["events/p"].attrs.get("unit") == _POLARITY:
            types["p"] = "|u1"
        if is_in(file, "t_offset"):
            types["t"] = "<u4"
        # a reader makes 64 bytes of an event
        columns = {name: numbers_in(file, f"events/{name}", "iuf", 1, 64) for name in types}
        starts = numbers_in(file, "frame_start", "i", 1)
        for key, stated in {**types, "starts": "<i8"}.items():
            column = columns.get(key, starts)
            if column.dtype != np.dtype(stated) or column.ndim != 1:
                raise ValueError(f"{key} is {column.dtype} {column.shape}")
        t, x, y = columns["t"], columns["x"], columns["y"]
        has_all = all(len(column) == len(t) for column in columns.values())
        are_ends = len(starts) == frames + 1 and starts[0] == 0 and starts[-1] == len(t)
        if not (has_all and are_ends and np.all(np.diff(starts) >= 0)):
            raise ValueError(f"columns or starts do not share {len(t)} events among frames")
        if t.size and (x.max() >= width or y.max() >= height):
            raise ValueError(f"a pixel outside of {height} × {width}")
        backward = np.flatnonzero(np.diff(t.astype(np.int64)) < 0) + 1
        if not np.isin(backward, starts).all():
            raise ValueError("times that decrease within a frame")
        if types["t"] == "<u4":  # DSEC's
            offset_us = first_frame * period_ps // _PS_PER_US
            if (begin_us := numbers_in(file, "t_offset", "i", 0)) != offset_us:
                raise ValueError(f"t_offset {begin_us}; the first frame starts at {offset_us} µs")
            t = (t.astype(np.int64) + offset_us) * _PS_PER_US
            t = np.maximum(t, first_frame * period_ps)
    time_s = (t - np.repeat(origin.frame_starts_ps, np.diff(starts))) / _PICOSECONDS
    pixel = np.asarray(y.astype(np.uint32) * np.uint32(width) + x, np.uint32)
    is_on = columns["p"] > 0 if "p" in columns else None
    value, starts = columns.get("value"), starts.astype(np.int64)
    events = Events(time_s, pixel, starts, origin.shape, first_frame, value, is_on)
    return StoredEvents(events=events, origin=origin)


def _dataset(file: h5py.File, name: str, dtype: str) -> h5py.Dataset:
    dataset = file.create_dataset(
        f"events/{name}", (0,), dtype, maxshape=(None,), chunks=(16384,),
        fletcher32=name != "p", fillvalue=int(name == "p"),
    )  # fmt: skip
    dataset.attrs["unit"] = _UNITS[name]
    return dataset
