"""Binary frames in one `.npy` file, as visionsim and the Single Photon Challenge write them.

uint8 (T, H, ceil(W/8)), in color (T, H, ceil(W/8), C): eight pixels of a row in a byte, the most
significant bit first, the last byte of a row filled up with zeros.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.files import atomic_write
from megalopta.sensor.formats.layout import PackedLayout, unpack_frames
from megalopta.sensor.formats.recorded_frames import RecordedFrames, file_bytes, wanted

Bytes = NDArray[np.uint8]


def write_binary_npy(path: str | Path, packed: Bytes) -> None:
    """Write packed frames (T, H, ceil(W/8)), as of `expose_binary`, as one file."""
    with binary_npy_writer(path, packed.shape) as write:
        write(packed)


@contextmanager
def binary_npy_writer(
    path: str | Path, shape: tuple[int, ...]
) -> Iterator[Callable[[Bytes], None]]:
    """Yield what appends packed frames; the file appears when all (T, H, ceil(W/8)) are there.

    Raises
    ------
    ValueError
        When other frames are written than the shape says.
    """
    with atomic_write(Path(path)) as temporary, temporary.open("wb") as file:
        header = {"descr": "|u1", "fortran_order": False, "shape": tuple(shape)}
        np.lib.format.write_array_header_1_0(file, header)
        written = 0

        def write(packed: Bytes) -> None:
            nonlocal written
            if packed.dtype != np.uint8 or packed.shape[1:] != tuple(shape[1:]):
                raise ValueError(f"packed: {packed.dtype} {packed.shape}; give uint8 (T, {shape})")
            file.write(np.ascontiguousarray(packed).data)
            written += len(packed)

        yield write
        if written != shape[0]:
            raise ValueError(f"{path}: {written} frames were written of {shape[0]}")


def read_binary_npy(
    path: str | Path,
    layout: PackedLayout | None = None,
    *,
    width: int | None = None,
    first: int = 0,
    frames: int | None = None,
) -> RecordedFrames:
    """Read packed frames, as bits; frames of bool, or of numbers wider than a byte, as they are.

    Parameters
    ----------
    path
    layout : PackedLayout, optional
    width : int, optional
        Pixels of a row, if not a multiple of eight.
    first, frames : int
        Which frames to read; by default all.

    Raises
    ------
    ValueError
        When the file is damaged or holds no frames.
    """
    path, layout = Path(path), layout or PackedLayout()
    array = _mapped(path)
    if array.ndim not in (3, 4) or array.dtype.kind not in "bui" or 0 in array.shape:
        raise ValueError(
            f"{path}: {array.dtype} {array.shape}; give uint8 (T, H, W/8) or (T, H, W/8, C) of "
            "packed bits, or counts (T, H, W)"
        )
    part = array[wanted(len(array), first, frames, path)]
    if array.dtype != np.uint8:
        return _counts(part, path)
    if width is not None and not 0 <= -width + 8 * array.shape[2] < 8:
        raise ValueError(
            f"{path}: width {width}, but rows have {array.shape[2]} bytes of 8 pixels: give the "
            "width of the sensor; if it is the height, the file is transposed"
        )
    colors = part[..., np.newaxis] if array.ndim == 3 else part
    bits = [
        unpack_frames(colors[..., color], layout, path, width) for color in range(colors.shape[3])
    ]
    counts = bits[0] if array.ndim == 3 else np.stack(bits, axis=-1)
    return RecordedFrames(counts=counts, bit_depth=1, exposure_s=None, source="npy")


def _counts(frames: NDArray[Any], path: Path) -> RecordedFrames:
    """Frames of bits or of wider numbers, as they are."""
    if frames.dtype.kind == "i" and frames.min() < 0:
        raise ValueError(f"{path}: has counts below 0; give counts as they were read")
    depth = 1 if frames.dtype == np.bool_ else 8 * frames.itemsize
    counts = frames.astype(np.uint8) if depth == 1 else np.array(frames)
    return RecordedFrames(counts=counts, bit_depth=depth, exposure_s=None, source="npy")


def _mapped(path: Path) -> NDArray[Any]:
    """The array of a file, read where it is used; nothing is unpickled."""
    if file_bytes(path)[:6].tobytes() != b"\x93NUMPY":
        raise ValueError(f"{path}: no .npy file; give one, or the kind that it is")
    try:
        return np.asarray(np.load(path, mmap_mode="r", allow_pickle=False))
    except (ValueError, OSError, EOFError, SyntaxError, TypeError, KeyError, OverflowError) as why:
        raise ValueError(
            f"{path}: damaged, cut short or not of plain numbers ({_line(why)}); copy it again"
        ) from None


def _line(problem: Exception) -> str:
    return " ".join(str(problem).split())[:120]
