"""Any file of frames or of events, recognized by what is in it."""

from collections.abc import Callable
from pathlib import Path
from typing import Literal, TypeAlias, get_args

from megalopta.sensor.formats.events import (
    HDF5_SIGNATURE,
    NPZ_SIGNATURE,
    StoredEvents,
    read_events_hdf5,
    read_events_npz,
)
from megalopta.sensor.formats.packed import PackedLayout, read_binary_npy, read_raw
from megalopta.sensor.formats.recorded_frames import RecordedFrames, file_bytes
from megalopta.sensor.formats.spc3 import SPC3_SIGNATURE, read_spc3
from megalopta.sensor.formats.tiff import read_tiff

FrameKind: TypeAlias = Literal["npy", "spad512", "swissspad2", "swissspad2_whole", "spc3", "tiff"]

_SIGNATURES: dict[bytes, FrameKind] = {
    b"\x93NUMPY": "npy",
    SPC3_SIGNATURE: "spc3",
    b"II*\0": "tiff",
    b"MM\0*": "tiff",
    b"II+\0": "tiff",
    b"MM\0+": "tiff",
}
_EVENTS: dict[bytes, Callable[[Path], StoredEvents]] = {
    HDF5_SIGNATURE: read_events_hdf5,
    NPZ_SIGNATURE: read_events_npz,
}


def read_frames(
    path: str | Path,
    kind: FrameKind | None = None,
    *,
    layout: PackedLayout | None = None,
    shape: tuple[int, int] | None = None,
    counter: int = 1,
    frames: slice = slice(None),
) -> RecordedFrames:
    """Read frames of any format that is known.

    Parameters
    ----------
    path
        A file, or a folder of `.bin` files.
    kind : str, optional
        The format; by default as the content says, `spad512` for files `RAW….bin`.
    layout : PackedLayout, optional
        Of binary frames, where it is not that of the format.
    shape : (rows, columns), optional
        Of the image that is expected; another one is refused.
    counter : int
        Which one of a `.spc3` file.
    frames : slice
        Which frames to read, one after the other; by default all.

    Raises
    ------
    FileNotFoundError
        When there is nothing.
    ValueError
        When the file is damaged, cut short, of no format that is known, or its image is not as
        expected.
    """
    path = Path(path)
    kind = kind or _kind(path)
    if kind not in get_args(FrameKind):
        raise ValueError(f"kind {kind!r} is unknown: use one of {', '.join(get_args(FrameKind))}")
    if layout is not None and kind in ("spc3", "tiff"):
        raise ValueError(
            f"{path}: layout is for binary frames, but this is a file of kind {kind!r}"
        )
    if kind == "npy":
        found = read_binary_npy(path, frames, layout, None if shape is None else shape[1])
    elif kind == "spc3":
        found = read_spc3(path, frames, counter)
    elif kind == "tiff":
        found = read_tiff(path, frames)
    else:
        found = read_raw(path, kind, frames, layout)
    return _expected(path, found, shape)


def read_events(path: str | Path) -> StoredEvents:
    """Read events from HDF5 or `.npz`.

    Raises
    ------
    FileNotFoundError
        When there is nothing.
    ValueError
        When the file is of another format, damaged or cut short.
    """
    path = Path(path)
    beginning = file_bytes(path)[:8].tobytes()
    for signature, read in _EVENTS.items():
        if beginning.startswith(signature):
            return read(path)
    raise ValueError(f"{path}: no events; give an HDF5 or .npz file that megalopta wrote")


def _kind(path: Path) -> FrameKind:
    first = min(path.glob("*.bin"), default=path) if path.is_dir() else path
    if path.is_dir() and first == path:
        raise FileNotFoundError(f"{path}: no .bin files in this folder; give that of a recording")
    beginning = file_bytes(first)[:8].tobytes()
    for signature, kind in _SIGNATURES.items():
        if beginning.startswith(signature):
            return kind
    if beginning.startswith(tuple(_EVENTS)):
        raise ValueError(f"{path}: holds events, no frames; use read_events")
    if first.name.startswith("RAW") and first.suffix == ".bin":  # as the SPAD512S names them
        return "spad512"
    raise ValueError(
        f"{path}: of no format that is known, or its beginning is damaged; give one of the kinds "
        f"{', '.join(get_args(FrameKind))}"
    )


def _expected(path: Path, found: RecordedFrames, shape: tuple[int, int] | None) -> RecordedFrames:
    rows, columns = found.counts.shape[1:3]
    if shape is None or (rows, columns) == tuple(shape):
        return found
    is_turned = (columns, rows) == tuple(shape)
    hint = (
        "it is transposed: exchange the axes of what is read" if is_turned else "give another file"
    )
    raise ValueError(f"{path}: images of {rows} × {columns}, not {shape[0]} × {shape[1]}; {hint}")
