"""Event streams in `.npz`, for `numpy.load`: arrays `t`, `x`, `y` (`event_stream`) and `starts`.

`starts` is the number of each frame's first event, int64; `origin` tells of the frames, as JSON.
Uncompressed, never pickled.
"""

import json
import zipfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from io import BytesIO
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
from numpy.typing import NDArray

from megalopta.core.files import atomic_write, remove
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

NPZ_SIGNATURE: Final = b"PK\x03\x04"

_TYPES = {"t": "<i8", "x": "<u2", "y": "<u2"}
_COPIED_BYTES = 2**22


def write_events_npz(path: str | Path, events: Events, origin: EventOrigin) -> None:
    """Write events as one file."""
    with events_npz_writer(path, origin) as write:
        write(events)


@contextmanager
def events_npz_writer(path: str | Path, origin: EventOrigin) -> Iterator[Callable[[Events], None]]:
    """Yield what appends events of the next frames; the file appears when all are there.

    An array's length stands before it, so arrays wait in files of their own until it is known.

    Raises
    ------
    ValueError
        When the events are of other frames than the origin says.
    """
    with atomic_write(Path(path)) as temporary, ExitStack() as waiting:
        temporary.parent.mkdir(parents=True, exist_ok=True)
        columns = {name: _waiting(temporary, name, waiting) for name in _TYPES}
        starts = [0]

        def write(events: Events) -> None:
            begin = starts[-1]
            t, x, y = columns_of(events, origin)
            columns["t"].write(t.data)
            columns["x"].write(x.data)
            columns["y"].write(y.data)
            starts.extend((begin + events.starts[1:]).tolist())

        yield write
        check_frames(path, len(starts) - 1, origin)
        text = json.dumps(origin.attributes()).encode()
        with zipfile.ZipFile(temporary, "w", zipfile.ZIP_STORED) as file:
            for name, column in columns.items():
                _add(file, name, _TYPES[name], starts[-1], column)
            for name, array in (
                ("starts", np.array(starts, "<i8")),
                ("origin", np.frombuffer(text, np.uint8)),
            ):
                with file.open(_member(name), "w") as member:
                    np.lib.format.write_array(member, array, allow_pickle=False)


def read_events_npz(path: str | Path) -> StoredEvents:
    """Read a file that `write_events_npz` wrote.

    Raises
    ------
    FileNotFoundError
        When there is nothing.
    ValueError
        When it is something else, damaged or cut short.
    """
    path = Path(path)
    size = file_bytes(path).size
    with damage_told(path), zipfile.ZipFile(path) as file:
        t, x, y = (_read(file, name, _TYPES[name], size) for name in "txy")
        starts = _read(file, "starts", "<i8", size)
        attributes = dict(json.loads(_read(file, "origin", "|u1", size).tobytes()))
    return stored_events(path, attributes, t, x, y, starts)


def _waiting(temporary: Path, name: str, waiting: ExitStack) -> IO[bytes]:
    # beside the output, on the same disk; its name is one that is swept after a kill
    path = temporary.with_name(f"{temporary.name}.{name}")
    waiting.callback(remove, path)
    return waiting.enter_context(path.open("w+b"))


def _member(name: str) -> zipfile.ZipInfo:
    """A member of a fixed date, so that the same events are the same bytes."""
    return zipfile.ZipInfo(f"{name}.npy")


def _add(file: zipfile.ZipFile, name: str, dtype: str, length: int, column: IO[bytes]) -> None:
    column.seek(0)
    with file.open(_member(name), "w", force_zip64=True) as member:
        header = {"descr": dtype, "fortran_order": False, "shape": (length,)}
        np.lib.format.write_array_header_1_0(member, header)
        while block := column.read(_COPIED_BYTES):
            member.write(block)


def _read(file: zipfile.ZipFile, name: str, dtype: str, size: int) -> NDArray[Any]:
    """Array of a member, if it is of its type and no larger than the file."""
    info = file.getinfo(f"{name}.npy")
    if info.compress_type != zipfile.ZIP_STORED or info.file_size > size:
        raise ValueError(f"{name} is compressed, or larger than the file")
    content = file.read(info)  # checks its sum
    array = np.lib.format.read_array(BytesIO(content), allow_pickle=False)
    if array.dtype != np.dtype(dtype) or array.ndim != 1:
        raise ValueError(f"{name} is {array.dtype} {array.shape}")
    return np.asarray(array)
