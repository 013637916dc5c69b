"""Arrays in `.npy`, and raw frames of a known layout, such as those of SPAD cameras.

Layouts: `docs/reference/recorded-files.md`.
"""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from megalopta.core.bounded import mapped_array, undamaged
from megalopta.core.files import atomic_write
from megalopta.core.record import Record
from megalopta.sensor.formats.recorded_frames import Stack, Values, file_bytes, parts_in


class Layout(Record, frozen=True):
    """Layout of raw frames, which follow each other in a file, or in all of a folder."""

    rows: Annotated[int, Field(gt=0, le=2**16)]
    columns: Annotated[int, Field(gt=0, le=2**16)]
    """Rows and columns as they are stored."""
    bits: Literal[1, 8, 16] = 1
    """Bits of a pixel; of 16, the low byte first."""
    bit_order: Literal["msb", "lsb"] = "msb"
    """Bit of a byte that is its first pixel: the most or the least significant."""
    row_bytes: Annotated[int, Field(gt=0, le=2**20)] | None = None
    """Bytes of a row; null: no more than its pixels need."""
    header_bytes: Annotated[int, Field(ge=0)] = 0
    footer_bytes: Annotated[int, Field(ge=0)] = 0
    """Bytes before and after the frames of each file."""
    orientation: tuple[Literal["transposed", "upside_down", "mirrored"], ...] = ()
    """Turns that make the picture of what is stored, one after the other."""


CAMERAS = {
    "spad512": Layout(rows=512, columns=512),
    "swissspad2": Layout(rows=256, columns=512, bit_order="lsb"),
    "swissspad2_whole": Layout(rows=512, columns=512, bit_order="lsb"),
}
"""Layouts of cameras."""
_TURNS: dict[str, Callable[[NDArray[Any]], NDArray[Any]]] = {
    "transposed": lambda image: image.swapaxes(1, 2),
    "upside_down": lambda image: image[:, ::-1],
    "mirrored": lambda image: image[:, :, ::-1],
}
_PERIOD_FRAMES = 1000
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


@contextmanager
def opened_npy(
    path: Path, shape: tuple[int, int] | None, is_packed: bool | None, values: Values | None
) -> Iterator[Stack]:
    """Open frames of packed bits, of bits or of counts.

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
    if array.dtype != np.uint8:
        is_packed = None if is_packed is None else False
    elif is_packed is None:
        if path.name.endswith(_PACKED_NAMES + _SUM_NAMES):
            is_packed = path.name.endswith(_PACKED_NAMES)
        elif shape is not None:
            is_packed = tuple(shape) != array.shape[1:3]
        elif values is None and array.max() > 1:
            raise ValueError(
                f"{path}: numbers of 8 bits may be eight pixels each, or counts; state the "
                "format, packed_npy or npy, by --format or in recording.yaml, or save uint16"
            )
    width = None if shape is None else shape[1]
    if is_packed and width is not None and not 0 <= -width + 8 * array.shape[2] < 8:
        raise ValueError(
            f"{path}: width {width}, but rows have {array.shape[2]} bytes of 8 pixels: give the "
            "width of the sensor; if it is the height, the file is transposed"
        )
    if is_packed:
        unpacked, frame_bytes = partial(np.unpackbits, axis=2, count=width), 8 * array[0].nbytes
        yield Stack(
            "packed_npy", len(array), frame_bytes, lambda part: unpacked(array[part]), bits=1
        )
        return
    are_counts = is_packed is False and array.dtype.kind == "u" and values is None
    bits = 8 * array.itemsize if are_counts else None
    yield Stack("npy", len(array), array[0].nbytes, lambda part: np.array(array[part]), bits)


def raw_files(path: Path) -> list[Path]:
    """Return the raw files of a folder, `.bin` or `.raw`, in natural order, or a file itself."""
    if not (files := parts_in(path, ".bin", ".raw")):
        raise FileNotFoundError(f"{path}: no .bin, .png or .tif files; give a folder with frames")
    return files


@contextmanager
def opened_raw(path: Path, kind: str, layout: Layout) -> Iterator[Stack]:
    """Open a raw file, or all files of a folder in natural order; raises as `read_frames`."""
    rows, columns = layout.rows, layout.columns
    row_bytes = layout.row_bytes or -(-columns * layout.bits // 8)
    if 8 * row_bytes < columns * layout.bits:
        raise ValueError(
            f"layout: row_bytes {row_bytes} are less than {columns} pixels; correct it"
        )
    total, read_stored = _joined(raw_files(path), rows * row_bytes, layout)

    def read(part: slice) -> NDArray[Any]:
        stored = read_stored(part).reshape(-1, rows, row_bytes)
        if kind == "swissspad2_whole":
            quarters = stored.reshape(-1, rows // 2, 4, 2, columns // 32)
            halves = np.moveaxis(quarters, 3, 1).reshape(-1, 2, rows // 2, columns // 8)
            stored = np.concatenate([halves[:, 0], halves[:, 1, ::-1]], axis=1)
        if layout.bits > 1:
            image = stored.view(f"<u{layout.bits // 8}")[:, :, :columns]
        else:
            order: Literal["big", "little"] = "big" if layout.bit_order == "msb" else "little"
            image = np.unpackbits(stored, axis=2, bitorder=order, count=columns)
            _check_bit_order(path, image, layout.bit_order)
        for turn in layout.orientation:
            image = _TURNS[turn](image)
        return image

    yield Stack(kind, total, 8 * rows * row_bytes, read, 1 if layout.bits == 1 else None)


def _check_bit_order(path: Path, bits: NDArray[np.uint8], order: str) -> None:
    """Refuse frames whose columns have a period of 8, as the other order of bits gives.

    Where bytes meet, neighboring pixels differ more than those that the other order would bring
    together, 15 apart. A mean difference, of 8 pairs of columns or more, above 6 standard errors
    tells it, in bands of 4 rows, or of more, with less noise.
    """
    mean = bits[:_PERIOD_FRAMES].mean(axis=0, dtype=np.float64)[:, : bits.shape[2] // 8 * 8]
    for rows in (4, 16, 64) if len(bits) and mean.shape[1] > 64 else ():
        bands = np.add.reduceat(mean, range(0, len(mean), rows)).reshape(-1, mean.shape[1] // 8, 8)
        near = np.square(bands[:, 1:, 0] - bands[:, :-1, 7])
        far = np.square(bands[:, 1:, 7] - bands[:, :-1, 0])
        excess = ((near - far) / np.maximum(near + far, 1e-12)).mean(axis=0)
        if excess.mean() > 6 * excess.std() / (excess.size - 1) ** 0.5 + 0.02:
            reversed_order = "lsb" if order == "msb" else "msb"
            raise ValueError(
                f"{path}: rates of its columns have a period of 8, so the bits of a byte are in "
                f"the other order; state format: raw, and bit_order: {reversed_order} in its layout"
            )


@contextmanager
def opened_halves(folder: Path) -> Iterator[Stack]:
    """Open `top1.bin`, `btm1.bin`, …, counts of SwissSPAD2's halves; raises as `read_frames`."""
    layout, files = Layout(rows=256, columns=512, bits=8), raw_files(folder)
    halves, numbers = [], set()
    for half in ("top", "btm"):
        own = [file for file in files if re.fullmatch(half + "[0-9]{1,9}", file.stem)]
        halves.append(_joined(own, 256 * 512, layout))
        numbers.add((halves[-1][0], *(file.stem[3:] for file in own)))
    if len(numbers) > 1 or not halves[0][0]:
        raise ValueError(f"{folder}: top and btm differ in files or frames; copy both again")

    def read(part: slice) -> NDArray[Any]:
        banks = [stored(part).reshape(-1, 256, 4, 128).swapaxes(2, 3) for _, stored in halves]
        top, bottom = (bank.reshape(-1, 256, 512) for bank in banks)
        return np.concatenate([top, bottom[:, ::-1]], axis=1)

    yield Stack("swissspad2_counts", halves[0][0], 2 * 256 * 512, read, bits=8)


def _joined(
    files: list[Path], frame_bytes: int, layout: Layout
) -> tuple[int, Callable[[slice], NDArray[np.uint8]]]:
    """Return how many frames files hold, and a function that reads some, (T, frame_bytes)."""
    parts, starts = [], [0]
    for file in files:
        body = file_bytes(file)
        body = body[layout.header_bytes : max(body.size - layout.footer_bytes, 0)]
        if body.size % frame_bytes == len(_FOOTER) and body[-len(_FOOTER) :].tobytes() == _FOOTER:
            body = body[: -len(_FOOTER)]
        if body.size == 0 or body.size % frame_bytes:
            raise ValueError(
                f"{file}: {body.size} bytes are not a whole number of frames of {frame_bytes}; it "
                "is cut short or of another format"
            )
        parts.append(body.reshape(-1, frame_bytes))
        starts.append(starts[-1] + len(parts[-1]))

    def read(part: slice) -> NDArray[np.uint8]:
        ranges = [slice(max(part.start - at, 0), max(part.stop - at, 0)) for at in starts]
        return np.concatenate([stored[own] for stored, own in zip(parts, ranges, strict=False)])

    return starts[-1], read
