"""Reader of files of frames or events, recognized by content.

**Frames of MPD's SPC3 cameras**, `.spc3` files, from software 1.11 on, are read here. Eight bytes
of signature, 1024 of header, then frames of 8 or 16 bits, little-endian; with several counters,
frame 1 of each, frame 2 of each, and so on. A frame is stored as lines of 32 pixels, each of which
becomes a column, as in MPD's own Python reader. Multibyte fields are little-endian.

Layout: MPD, SPC3 SDK (header `SPC3_SDK.h`).
"""

from collections.abc import Callable
from pathlib import Path
from typing import Literal, TypeAlias, get_args

import numpy as np

from megalopta.sensor.formats.events import (
    HDF5_SIGNATURE,
    NPZ_SIGNATURE,
    StoredEvents,
    read_events_hdf5,
    read_events_npz,
)
from megalopta.sensor.formats.packed import PackedLayout, read_binary_npy, read_raw
from megalopta.sensor.formats.recorded_frames import RecordedFrames, file_bytes, read_tiff, wanted

FrameKind: TypeAlias = Literal[
    "npy", "packed_npy", "spad512", "swissspad2", "swissspad2_whole", "spc3", "tiff"
]

_SPC3_SIGNATURE = bytes.fromhex("4d5044ff03000001")
_SIGNATURES: dict[bytes, FrameKind] = {
    b"\x93NUMPY": "npy",
    _SPC3_SIGNATURE: "spc3",
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
    """Read frames of any known format.

    Raises FileNotFoundError if the path does not exist; ValueError if the file is damaged,
    truncated or of an unknown format, or its image is not as expected.

    Parameters
    ----------
    path
        A file, or a folder of `.bin` files.
    kind : str, optional
        Format; by default detected from the content, `spad512` for files `RAW….bin`. `.npy` of
        numbers of 8 bits above 1 needs `npy`, for counts, or `packed_npy`, for packed bits, unless
        `layout`, `shape` or the name of a product says it.
    layout : PackedLayout, optional
        Layout of binary frames, if not that of the format.
    shape : (rows, columns), optional
        Expected image size; another one raises an error.
    counter : int
        Counter to read from a `.spc3` file.
    frames : slice
        Consecutive frames to read; default: all.
    """
    path, stated = Path(path), kind
    kind = kind or _kind(path)
    if kind not in get_args(FrameKind):
        raise ValueError(f"kind {kind!r} is unknown: use one of {', '.join(get_args(FrameKind))}")
    if layout is not None and kind in ("spc3", "tiff"):
        raise ValueError(
            f"{path}: layout is for binary frames, but this is a file of kind {kind!r}"
        )
    if kind == "npy" or kind == "packed_npy":
        is_packed = None if stated is None else kind == "packed_npy"
        found = read_binary_npy(path, frames, layout, shape, is_packed)
    elif kind == "spc3":
        found = _spc3(path, frames, counter)
    elif kind == "tiff":
        found = read_tiff(path, frames)
    else:
        found = read_raw(path, kind, frames, layout)
    rows, columns = found.counts.shape[1:3]
    if shape is None or (rows, columns) == tuple(shape):
        return found
    is_turned = (columns, rows) == tuple(shape)
    hint = (
        "it is transposed: exchange the axes of what is read" if is_turned else "give another file"
    )
    raise ValueError(f"{path}: images of {rows} × {columns}, not {shape[0]} × {shape[1]}; {hint}")


def read_events(path: str | Path) -> StoredEvents:
    """Read events from HDF5 or `.npz`.

    Raises FileNotFoundError if the path does not exist; ValueError if the file is of another
    format, damaged or truncated.
    """
    path = Path(path)
    beginning = file_bytes(path)[:8].tobytes()
    for signature, read in _EVENTS.items():
        if beginning.startswith(signature):
            return read(path)
    raise ValueError(f"{path}: no events; give an HDF5 or .npz file written by megalopta")


_LINE = 32
_DATA = 8 + 1024
# Offsets count from the end of the signature.
_HEADER = np.dtype(
    {
        "names": [
            "rows", "columns", "bits", "counters", "integration_10ns", "summed_frames",
            "hold_off_ns", "is_signed", "frames", "is_averaged", "pixels",
        ],
        "formats": ["u1", "u1", "u1", "u1", "<u2", "<u2", "<u2", "u1", "<u4", "u1", "<u2"],
        "offsets": [100, 101, 102, 103, 104, 106, 110, 113, 114, 118, 126],
        "itemsize": 1024,
    }
)  # fmt: skip


def _spc3(path: Path, frames: slice, counter: int) -> RecordedFrames:
    """Read the frames of one counter, 1 to 3, as (T, 32, pixels/32) uint8 or uint16.

    Counters 1 and 2 are signed after the camera's background subtraction. Raises as `read_frames`,
    and ValueError if there is no such counter.
    """
    content = file_bytes(path)
    if content[:8].tobytes() != _SPC3_SIGNATURE:
        raise ValueError(f"{path}: no .spc3 file of software 1.11 or later; give one")
    if content.size < _DATA:
        raise ValueError(f"{path}: cut short within its header; copy it again")
    header: np.void = content[8:_DATA].view(_HEADER)[0]
    for name, allowed in (
        ("bits", (8, 16)),
        ("counters", (1, 2, 3)),
        ("summed_frames", range(1, 2**16)),
        ("integration_10ns", range(1, 2**16)),
        ("pixels", range(_LINE, 2**16, _LINE)),
        ("is_signed", (0, 1)),
    ):
        if int(header[name]) not in allowed:
            raise ValueError(
                f"{path}: its header gives {name} {header[name]}; the file is damaged or of "
                "another camera: copy it again"
            )
    if int(header["rows"]) * int(header["columns"]) != int(header["pixels"]):
        raise ValueError(
            f"{path}: its header gives {header['rows']} × {header['columns']} pixels and "
            f"{header['pixels']} in all; it is damaged: copy it again"
        )
    if header["is_averaged"]:
        raise ValueError(f"{path}: holds one averaged image, no counts; save the frames themselves")
    counters, pixels = int(header["counters"]), int(header["pixels"])
    if not 1 <= counter <= counters:
        raise ValueError(f"{path}: counter {counter}; it has {counters}, give one of them")
    is_signed = bool(header["is_signed"]) and counter < 3
    dtype = np.dtype(f"<{'i' if is_signed else 'u'}{header['bits'] // 8}")
    total = int(header["frames"])
    size = total * counters * pixels * dtype.itemsize
    if content.size != _DATA + size:
        raise ValueError(
            f"{path}: {content.size} bytes, but its header states {total} frames, {_DATA + size} "
            "bytes; it is cut short or its header damaged: copy it again"
        )
    lines = content[_DATA:].view(dtype).reshape(total, counters, pixels // _LINE, _LINE)
    chosen = lines[wanted(total, frames, path, pixels * dtype.itemsize), counter - 1]
    counts = np.ascontiguousarray(np.swapaxes(chosen, 1, 2)).astype(dtype.newbyteorder("="))
    exposure_s = int(header["integration_10ns"]) * int(header["summed_frames"]) * 1e-8
    return RecordedFrames(
        counts=counts,
        bit_depth=int(header["bits"]),
        exposure_s=exposure_s,
        source="spc3",
        total=total,
    )


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
