"""Reader of files of frames, recognized by content; frames of MPD's SPC3 cameras.

Layout: `docs/reference/recorded-files.md`, from MPD's SPC3 SDK (header `SPC3_SDK.h`).
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from megalopta.core.pictures import PNG_SIGNATURE
from megalopta.sensor.formats import matlab, packed, pictures, recorded_frames as recorded
from megalopta.sensor.formats.events import HDF5_SIGNATURE

FrameKind: TypeAlias = Literal[
    "npy", "packed_npy", "spad512", "swissspad2", "swissspad2_whole", "swissspad2_counts", "spc3",
    "tiff", "png", "mat", "hdf5", "raw",
]  # fmt: skip

_SPC3_SIGNATURE = bytes.fromhex("4d5044ff03000001")
_SIGNATURES: dict[bytes, FrameKind] = {
    b"\x93NUMPY": "npy",
    _SPC3_SIGNATURE: "spc3",
    b"II*\0": "tiff",
    b"MM\0*": "tiff",
    b"II+\0": "tiff",
    b"MM\0+": "tiff",
    PNG_SIGNATURE: "png",
    matlab.SIGNATURE: "mat",
    HDF5_SIGNATURE: "hdf5",
}


def read_frames(
    path: str | Path,
    kind: FrameKind | None = None,
    *,
    shape: tuple[int, int] | None = None,
    counter: int = 1,
    frames: slice = slice(None),
    values: recorded.Values | None = None,
    variable: str | None = None,
    layout: packed.Layout | None = None,
) -> recorded.RecordedFrames:
    """Read frames of any known format from a file, or a folder of raw files or pictures.

    `kind`: the format, by default detected from the content, `spad512` for files `RAW….bin`,
    `swissspad2_counts` for a folder of `topN.bin` and `btmN.bin`; `.npy` of numbers of 8 bits above
    1 needs `npy`, for counts, or `packed_npy`, for packed bits, unless `shape` or the name of a
    product says it. `shape`: (rows, columns) that are expected; `counter`: to read from a `.spc3`
    file; `frames`: consecutive ones to read; `values`: bits or counts, by default known by the type
    of numbers, or the numbers of the recording; `variable`: array of a `.mat` or HDF5 file;
    `layout`: that of `raw` files.

    Raises FileNotFoundError if the path does not exist; ValueError if the file is damaged,
    truncated or of an unknown format, or its image is not as expected.
    """
    path, stated = Path(path), kind
    kind = kind or ("raw" if layout else _kind(path))
    if kind not in get_args(FrameKind):
        raise ValueError(f"kind {kind!r} is unknown: use one of {', '.join(get_args(FrameKind))}")
    if kind == "npy" or kind == "packed_npy":
        is_packed = None if stated is None else kind == "packed_npy"
        opened = packed.opened_npy(path, shape, is_packed, values)
    elif kind == "spc3":
        opened = _opened_spc3(path, counter)
    elif kind == "swissspad2_counts":
        opened = packed.opened_halves(path)
    elif kind == "mat" or kind == "hdf5":
        opened = matlab.opened_arrays(path, variable)
    elif kind == "png" or kind == "tiff":
        opened = pictures.opened(path, kind)
    elif layout or kind in packed.CAMERAS:
        opened = packed.opened_raw(path, kind, layout or packed.CAMERAS[kind])
    else:
        raise ValueError(f"{path}: raw frames; state their layout: rows, columns, bit_order, …")
    with opened as stack:
        recording = stack.frames(path, frames, values)
    rows, columns = recording.counts.shape[1:3]
    if shape is not None and (rows, columns) != tuple(shape):
        is_turned = (columns, rows) == tuple(shape)
        remedy = "it is transposed: exchange its axes" if is_turned else "give another file"
        raise ValueError(
            f"{path}: images of {rows} × {columns}, not {shape[0]} × {shape[1]}; {remedy}"
        )
    return recording


_LINE = 32
_DATA = 8 + 1024
# Offsets count from the end of the signature.
_HEADER = np.dtype(
    {
        "names": [
            "rows", "columns", "bits", "counters", "integration_10ns", "summed_frames",
            "is_signed", "frames", "is_averaged", "pixels",
        ],
        "formats": ["u1", "u1", "u1", "u1", "<u2", "<u2", "u1", "<u4", "u1", "<u2"],
        "offsets": [100, 101, 102, 103, 104, 106, 113, 114, 118, 126],
        "itemsize": 1024,
    }
)  # fmt: skip


@contextmanager
def _opened_spc3(path: Path, counter: int) -> Iterator[recorded.Stack]:
    """Open the frames of one counter, 1 to 3, (T, 32, pixels/32); raises as `read_frames`."""
    content = recorded.file_bytes(path)
    if content[:8].tobytes() != _SPC3_SIGNATURE:
        raise ValueError(f"{path}: no .spc3 file of software 1.11 or later; give one")
    if content.size < _DATA:
        raise ValueError(f"{path}: cut short within its header; copy it again")
    stated: np.void = content[8:_DATA].view(_HEADER)[0]
    header = {name: int(stated[name]) for name in _HEADER.names or ()}
    pixels, counters = header["rows"] * header["columns"], header["counters"]
    total = header["frames"]
    for name, possible in (
        ("bits", (8, 16)),
        ("counters", (1, 2, 3)),
        ("summed_frames", range(1, 2**16)),
        ("integration_10ns", range(1, 2**16)),
        ("pixels", [pixels] if pixels in range(_LINE, 2**16, _LINE) else []),
        ("is_signed", (0, 1)),
        ("is_averaged", (0,)),  # an average holds no counts
    ):
        if header[name] not in possible:
            raise ValueError(
                f"{path}: its header gives {name} {header[name]}; the file is damaged, of another "
                "camera, or holds no counts: copy it again, or save the frames themselves"
            )
    if not 1 <= counter <= counters:
        raise ValueError(f"{path}: counter {counter}; it has {counters}, give one of them")
    # after the camera's background subtraction
    is_signed = header["is_signed"] and counter < 3
    dtype = np.dtype(f"<{'i' if is_signed else 'u'}{header['bits'] // 8}")
    size = total * counters * pixels * dtype.itemsize
    if content.size != _DATA + size:
        raise ValueError(
            f"{path}: {content.size} bytes, but its header states {total} frames, {_DATA + size} "
            "bytes; it is cut short or its header damaged: copy it again"
        )
    lines = content[_DATA:].view(dtype).reshape(total, counters, pixels // _LINE, _LINE)
    exposure_s = header["integration_10ns"] * header["summed_frames"] * 1e-8

    def read(part: slice) -> NDArray[Any]:
        chosen = lines[part, counter - 1].swapaxes(1, 2)
        return np.ascontiguousarray(chosen).astype(dtype.newbyteorder("="))

    yield recorded.Stack(
        "spc3", total, pixels * dtype.itemsize, read, header["bits"], {"exposure_s": exposure_s}
    )


def _kind(path: Path) -> FrameKind:
    suffixes = chain(*pictures.SUFFIXES.values())
    first = (recorded.parts_in(path, *suffixes) or packed.raw_files(path))[0]
    beginning = recorded.file_bytes(first)[:8].tobytes()
    for signature, kind in _SIGNATURES.items():
        if beginning.startswith(signature):
            return kind
    if path.is_dir() and re.fullmatch("btm[0-9]+", first.stem):
        return "swissspad2_counts"
    if first.name.startswith("RAW") and first.suffix == ".bin":  # as the SPAD512S names them
        return "spad512"
    raise ValueError(
        f"{path}: of no format that is known, or its beginning is damaged; give one of the kinds "
        f"{', '.join(get_args(FrameKind))}, of raw frames with their layout"
    )
