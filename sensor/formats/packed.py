"""Binary frames, eight pixels in a byte: one `.npy` file, or raw `.bin` files of SPAD cameras.

Layouts: `docs/file-formats.md`.
"""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from megalopta.core.bounded import mapped_array, undamaged
from megalopta.core.files import atomic_write
from megalopta.sensor.formats.recorded_frames import RecordedFrames, file_bytes, wanted

_SHAPES = {"spad512": (512, 512), "swissspad2": (256, 512), "swissspad2_whole": (512, 512)}
_PACKED_NAMES, _SUM_NAMES = (".binary.npy", ".burst.npy"), (".sums.npy", ".brackets.npy")
"""Names of the products of packed bits and of their sums (`products`)."""
_FOOTER = b"DONE"
"""Sent by the SPAD512S after its frames, and kept by programs that store the whole stream."""


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


def read_binary_npy(
    path: Path, frames: slice, shape: tuple[int, int] | None, is_packed: bool | None
) -> RecordedFrames:
    """Read packed frames as bits; frames of bits or of counts are returned as they are.

    Numbers of 8 bits may be any of these: `is_packed`, the `shape` of the image or the name of this
    program's products says it. Numbers of 0 and 1 are bits. Raises as `read_frames`.
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
    if is_packed is None and path.name.endswith(_PACKED_NAMES + _SUM_NAMES):
        is_packed = path.name.endswith(_PACKED_NAMES)
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
    bits = np.unpackbits(part, axis=2, count=width)
    return RecordedFrames(counts=bits, bit_depth=1, source="packed_npy", total=len(array))


def raw_files(path: Path) -> list[Path]:
    """Return the `.bin` files of a folder in order of name, or a file itself."""
    files = sorted(path.glob("*.bin")) if path.is_dir() else [path]
    if not files:
        raise FileNotFoundError(f"{path}: no .bin files in this folder; give that of a recording")
    return files


def read_raw(
    path: Path, camera: Literal["spad512", "swissspad2", "swissspad2_whole"], frames: slice
) -> RecordedFrames:
    """Read a raw file, or all files of a folder in order of name; raises as `read_frames`."""
    rows, columns = _SHAPES[camera]
    packed, total = _frames_of(path, raw_files(path), rows * columns // 8, 8, frames)
    packed = packed.reshape(-1, rows, columns // 8)
    if camera == "swissspad2_whole":
        quarters = packed.reshape(-1, rows // 2, 4, 2, columns // 32)
        halves = np.moveaxis(quarters, 3, 1).reshape(-1, 2, rows // 2, columns // 8)
        packed = np.concatenate([halves[:, 0], halves[:, 1, ::-1]], axis=1)
    bits = np.unpackbits(packed, axis=2, bitorder="big" if camera == "spad512" else "little")
    return RecordedFrames(counts=bits, bit_depth=1, source=camera, total=total)


def read_halves(folder: Path, frames: slice) -> RecordedFrames:
    """Read `top1.bin`, `btm1.bin`, …, counts of SwissSPAD2's halves; raises as `read_frames`."""
    rows, columns = _SHAPES["swissspad2"]
    images, totals = [], set()
    for half in ("top", "btm"):
        files = [file for file in raw_files(folder) if re.fullmatch(half + "[0-9]{1,9}", file.stem)]
        files.sort(key=lambda file: int(file.stem[3:]))
        counts, total = _frames_of(folder, files, rows * columns, 2, frames)
        banks = counts.reshape(-1, rows, 4, columns // 4)
        images.append(banks.swapaxes(2, 3).reshape(-1, rows, columns))
        totals.add((total, *(file.stem[3:] for file in files)))
    if len(totals) > 1 or not total:
        raise ValueError(f"{folder}: top and btm differ in files or frames; copy both again")
    counts = np.concatenate([images[0], images[1][:, ::-1]], axis=1)
    return RecordedFrames(counts=counts, bit_depth=8, source="swissspad2_counts", total=total)


def _frames_of(
    path: Path, files: list[Path], frame_bytes: int, decoded: int, frames: slice
) -> tuple[NDArray[np.uint8], int]:
    """Return wanted frames (T, frame_bytes) of files in order, and how many there are.

    `decoded`: bytes of memory for each of theirs.
    """
    parts = []
    for file in files:
        body = file_bytes(file)
        if body.size % frame_bytes == len(_FOOTER) and body[-len(_FOOTER) :].tobytes() == _FOOTER:
            body = body[: -len(_FOOTER)]
        if body.size == 0 or body.size % frame_bytes:
            raise ValueError(
                f"{file}: {body.size} bytes are not a whole number of frames of {frame_bytes}; it "
                "is cut short or of another format"
            )
        parts.append(body.reshape(-1, frame_bytes))
    total = sum(map(len, parts))
    range_ = wanted(total, frames, path, decoded * frame_bytes)
    chosen, start = [], 0
    for part in parts:
        chosen.append(part[max(range_.start - start, 0) : max(range_.stop - start, 0)])
        start += len(part)
    return np.concatenate([np.empty((0, frame_bytes), np.uint8), *chosen]), total


def _counts(frames: NDArray[Any], path: Path, total: int) -> RecordedFrames:
    """Frames of bits or of wider numbers, as they are."""
    if frames.dtype.kind == "i" and frames.min() < 0:
        raise ValueError(f"{path}: has counts below 0; give raw counts")
    depth = 1 if frames.dtype == np.bool_ else 8 * frames.itemsize
    counts = frames.astype(np.uint8) if depth == 1 else np.array(frames)
    return RecordedFrames(counts=counts, bit_depth=depth, source="npy", total=total)
