"""Frames of MPD's SPC3 cameras, `.spc3` files, from software 1.11 on.

Eight bytes of signature, 1024 of header, then frames of 8 or 16 bits, little-endian; with several
counters, frame 1 of each, frame 2 of each, and so on. A frame is stored as lines of 32 pixels, each
of which becomes a column, as MPD's own Python reader turns it. Multibyte fields are little-endian.

Layout: MPD, SPC3 SDK (header `SPC3_SDK.h`).
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from megalopta.sensor.formats.recorded_frames import RecordedFrames, file_bytes, wanted

SPC3_SIGNATURE = bytes.fromhex("4d5044ff03000001")

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


def read_spc3(path: Path, frames: slice, counter: int) -> RecordedFrames:
    """Read the frames of one counter, 1 to 3, as (T, 32, pixels/32) uint8 or uint16.

    Counters 1 and 2 are signed after the camera's background subtraction. Raises as `read_frames`,
    and ValueError where there is no such counter.
    """
    content = file_bytes(path)
    header = _read_header(path, content)
    counters, pixels = int(header["counters"]), int(header["pixels"])
    if not 1 <= counter <= counters:
        raise ValueError(f"{path}: counter {counter}; it has {counters}, give one of them")
    is_signed = bool(header["is_signed"]) and counter < 3
    dtype = np.dtype(f"<{'i' if is_signed else 'u'}{header['bits'] // 8}")
    total = int(header["frames"])
    size = total * counters * pixels * dtype.itemsize
    if content.size != _DATA + size:
        raise ValueError(
            f"{path}: {content.size} bytes, but its header tells of {total} frames, {_DATA + size} "
            "bytes; it is cut short or its header damaged: copy it again"
        )
    lines = content[_DATA:].view(dtype).reshape(total, counters, pixels // _LINE, _LINE)
    chosen = lines[wanted(total, frames, path), counter - 1]
    counts = np.ascontiguousarray(np.swapaxes(chosen, 1, 2)).astype(dtype.newbyteorder("="))
    exposure_s = int(header["integration_10ns"]) * int(header["summed_frames"]) * 1e-8
    return RecordedFrames(
        counts=counts, bit_depth=int(header["bits"]), exposure_s=exposure_s, source="spc3"
    )


def _read_header(path: Path, content: NDArray[np.uint8]) -> np.void:
    if content[:8].tobytes() != SPC3_SIGNATURE:
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
    return header
