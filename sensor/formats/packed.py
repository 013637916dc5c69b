"""Binary frames, eight pixels in a byte: one `.npy` file, or raw `.bin` files of SPAD cameras.

- `.npy` as visionsim and the Single Photon Challenge write it: uint8 (T, H, ceil(W/8)), in color
  (T, H, ceil(W/8), C); the most significant bit first, the last byte of a row filled with zeros.
- Pi Imaging's SPAD512S: a folder of `RAW00000.bin`, `RAW00001.bin`, … without header, each (n, 512,
  64) with n up to 1000, the most significant bit first.
- SwissSPAD2: `.bin` files of 512 half frames or 256 whole ones, 8 MiB each, without header, the
  least significant bit first. A half frame is 256 × 512. A whole one, 512 × 512, is 256 lines of
  128 bytes: a quarter of a row of the top half, the same quarter of a row of the bottom half,
  counted from below, the next quarter of the top, and so on.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from megalopta.core.bounded import mapped_array, undamaged
from megalopta.core.files import atomic_write
from megalopta.sensor.formats.recorded_frames import (
    RecordedFrames,
    check_new,
    file_bytes,
    wanted,
)

Bytes = NDArray[np.uint8]

_SPAD512 = 512, 512
_FRAMES_PER_FILE = 1000
_SHAPES = {"spad512": _SPAD512, "swissspad2": (256, 512), "swissspad2_whole": (512, 512)}
_PACKED_NAMES = (".binary.npy", ".burst.npy")
"""Names of the products of packed bits (`products`)."""
_FOOTER = b"DONE"
"""Sent by the SPAD512S after its frames, and kept by programs that store the whole stream."""


class PackedLayout(BaseModel, frozen=True, extra="forbid", use_attribute_docstrings=True):
    """Layout of files that do not state it themselves."""

    bit_order: Literal["msb", "lsb"] = "msb"
    """Bit of a byte that is the first pixel: the most or the least significant."""
    packed_along: Literal["width", "height"] = "width"
    """Direction of the eight pixels of a byte: along a row (width) or a column (height)."""
    header_bytes: Annotated[int, Field(ge=0)] = 0
    """Bytes to skip at the start of every file."""
    footer_bytes: Annotated[int, Field(ge=0)] = 0
    """Bytes to skip at the end of every file."""


@contextmanager
def npy_writer(
    path: str | Path, shape: tuple[int, ...], dtype: str = "|u1"
) -> Iterator[Callable[[NDArray[Any]], None]]:
    """Yield a function that appends frames, such as packed ones; the file appears with all.

    Raises ValueError if the frames do not match the shape (T, …) and type.
    """
    with atomic_write(Path(path)) as temporary, temporary.open("wb") as file:
        header = {"descr": dtype, "fortran_order": False, "shape": tuple(shape)}
        np.lib.format.write_array_header_1_0(file, header)
        written = 0

        def write(frames: NDArray[Any]) -> None:
            nonlocal written
            if frames.dtype != np.dtype(dtype) or frames.shape[1:] != tuple(shape[1:]):
                raise ValueError(f"frames: {frames.dtype} {frames.shape}; give {dtype} {shape}")
            file.write(np.ascontiguousarray(frames).data)
            written += len(frames)

        yield write
        if written != shape[0]:
            raise ValueError(f"{path}: {written} frames were written of {shape[0]}")


@contextmanager
def spad512_writer(folder: str | Path) -> Iterator[Callable[[Bytes], None]]:
    """Yield a function that appends packed frames (T, 512, 64); the folder appears at the end.

    Raises FileExistsError if the folder exists, ValueError if frames have another size.
    """
    folder = Path(folder)
    check_new(folder)
    with atomic_write(folder) as temporary:
        temporary.mkdir()
        written = 0

        def write(packed: Bytes) -> None:
            nonlocal written
            check_spad512_size(packed.shape[1], 8 * packed.shape[2])
            for frame in packed:
                name = f"RAW{written // _FRAMES_PER_FILE:05d}.bin"
                with (temporary / name).open("ab") as file:
                    file.write(np.ascontiguousarray(frame).data)
                written += 1

        yield write


def check_spad512_size(rows: int, columns: int) -> None:
    """Check that frames are of the camera's size. Raises ValueError."""
    if (rows, columns) != _SPAD512:
        raise ValueError(
            f"frames of {columns} × {rows} pixels; files of the SPAD512S have 512 × 512: set the "
            "camera's width and height to 512, or write binary_npy"
        )


def read_binary_npy(
    path: Path,
    frames: slice,
    layout: PackedLayout | None,
    shape: tuple[int, int] | None,
    is_packed: bool | None,
) -> RecordedFrames:
    """Read packed frames as bits; frames of bits or of counts are returned as they are.

    Numbers of 8 bits may be any of these: `is_packed`, a layout, the `shape` of the image or the
    name of this program's products says it. Numbers of 0 and 1 are bits. Raises as `read_frames`.
    """
    if file_bytes(path)[:6].tobytes() != b"\x93NUMPY":
        raise ValueError(f"{path}: not a .npy file; give one, or set its kind")
    with undamaged(path, "give plain numbers, or copy it again"):
        array = mapped_array(path)
    if array.ndim not in (3, 4) or array.dtype.kind not in "bui" or 0 in array.shape:
        raise ValueError(
            f"{path}: {array.dtype} {array.shape}; give uint8 (T, H, W/8) or (T, H, W/8, C) of "
            "packed bits, or counts (T, H, W)"
        )
    frame_bytes = array[0].nbytes * (8 if array.dtype == np.uint8 else 1)
    part = array[wanted(len(array), frames, path, frame_bytes)]
    if array.dtype != np.uint8:
        return _counts(part, path, len(array))
    if is_packed is None and (layout is not None or path.name.endswith(_PACKED_NAMES)):
        is_packed = True
    if is_packed is None and shape is not None:
        is_packed = tuple(shape) != array.shape[1:3]
    if is_packed is None:
        if array.max() > 1:
            raise ValueError(
                f"{path}: numbers of 8 bits may be eight pixels each, or counts; state "
                "the format, packed_npy or npy, or save counts as uint16"
            )
        part = part.astype(np.bool_)
    if not is_packed:
        return _counts(part, path, len(array))
    width = None if shape is None else shape[1]
    if width is not None and not 0 <= -width + 8 * array.shape[2] < 8:
        raise ValueError(
            f"{path}: width {width}, but rows have {array.shape[2]} bytes of 8 pixels: give the "
            "width of the sensor; if it is the height, the file is transposed"
        )
    bits = _unpacked(part, layout or PackedLayout(), width)
    return RecordedFrames(counts=bits, bit_depth=1, source="packed_npy", total=len(array))


def read_raw(
    path: Path,
    camera: Literal["spad512", "swissspad2", "swissspad2_whole"],
    frames: slice,
    layout: PackedLayout | None,
) -> RecordedFrames:
    """Read a raw file, or all files of a folder in order of name; raises as `read_frames`."""
    layout = layout or PackedLayout(bit_order="msb" if camera == "spad512" else "lsb")
    rows, columns = _SHAPES[camera]
    frame_bytes = rows * columns // 8
    files = sorted(path.glob("*.bin")) if path.is_dir() else [path]
    if not files:
        raise FileNotFoundError(f"{path}: no .bin files in this folder; give that of a recording")
    parts = []
    for file in files:
        content = file_bytes(file)
        body = content[layout.header_bytes : content.size - layout.footer_bytes]
        if body.size % frame_bytes == len(_FOOTER) and body[-len(_FOOTER) :].tobytes() == _FOOTER:
            body = body[: -len(_FOOTER)]
        if body.size == 0 or body.size % frame_bytes:
            raise ValueError(
                f"{file}: {body.size} bytes are not a whole number of frames of {frame_bytes}; it "
                "is cut short or of another format, or give header_bytes and footer_bytes"
            )
        parts.append(body.reshape(-1, frame_bytes))
    total = sum(map(len, parts))
    range_ = wanted(total, frames, path, 8 * frame_bytes)
    chosen, start = [np.empty((0, frame_bytes), np.uint8)], 0
    for part in parts:
        chosen.append(part[max(range_.start - start, 0) : max(range_.stop - start, 0)])
        start += len(part)
    raw = np.concatenate(chosen)
    if camera == "swissspad2_whole":
        quarters = raw.reshape(-1, rows // 2, 4, 2, columns // 32)
        halves = np.moveaxis(quarters, 3, 1).reshape(-1, 2, rows // 2, columns // 8)
        packed = np.concatenate([halves[:, 0], halves[:, 1, ::-1]], axis=1)
    elif layout.packed_along == "width":
        packed = raw.reshape(-1, rows, columns // 8)
    else:
        packed = raw.reshape(-1, rows // 8, columns)
    bits = _unpacked(packed, layout)
    return RecordedFrames(counts=bits, bit_depth=1, source=camera, total=total)


def _unpacked(packed: Bytes, layout: PackedLayout, width: int | None = None) -> Bytes:
    """Bits (T, H, W) or (T, H, W, C) of packed frames."""
    along = 2 if layout.packed_along == "width" else 1
    order: Literal["big", "little"] = "little" if layout.bit_order == "lsb" else "big"
    return np.unpackbits(packed, axis=along, count=width, bitorder=order)


def _counts(frames: NDArray[Any], path: Path, total: int) -> RecordedFrames:
    """Frames of bits or of wider numbers, as they are."""
    if frames.dtype.kind == "i" and frames.min() < 0:
        raise ValueError(f"{path}: has counts below 0; give raw counts")
    depth = 1 if frames.dtype == np.bool_ else 8 * frames.itemsize
    counts = frames.astype(np.uint8) if depth == 1 else np.array(frames)
    return RecordedFrames(counts=counts, bit_depth=depth, source="npy", total=total)
