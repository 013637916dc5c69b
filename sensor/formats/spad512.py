"""Raw binary frames of Pi Imaging's SPAD512S: a folder of `RAW00000.bin`, `RAW00001.bin`, ….

No header: (n, 512, 64) uint8, n up to 1000, eight pixels of a row in a byte, the most significant
bit first. Some programs keep the four bytes `DONE` that the camera sends at the end.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from megalopta.core.files import atomic_write
from megalopta.sensor.formats.layout import PackedLayout, unpack_frames
from megalopta.sensor.formats.raw_bits import raw_frames
from megalopta.sensor.formats.recorded_frames import RecordedFrames

SPAD512_PIXELS = 512
"""Rows, and columns"""
FRAMES_PER_FILE = 1000

Bytes = NDArray[np.uint8]


def write_spad512(folder: str | Path, packed: Bytes) -> None:
    """Write packed frames (T, 512, 64) as files of a new folder."""
    with spad512_writer(folder) as write:
        write(packed)


@contextmanager
def spad512_writer(folder: str | Path) -> Iterator[Callable[[Bytes], None]]:
    """Yield what appends packed frames (T, 512, 64); the folder appears when all are there.

    Raises
    ------
    FileExistsError
        When something of this name exists.
    ValueError
        When frames have another size.
    """
    folder = Path(folder)
    if folder.exists():
        raise FileExistsError(f"{folder}: exists already; remove it or choose another name")
    with atomic_write(folder) as temporary:
        temporary.mkdir()
        written = 0

        def write(packed: Bytes) -> None:
            nonlocal written
            check_spad512_size(packed.shape[1], 8 * packed.shape[2])
            for frame in packed:
                name = f"RAW{written // FRAMES_PER_FILE:05d}.bin"
                with (temporary / name).open("ab") as file:
                    file.write(np.ascontiguousarray(frame).data)
                written += 1

        yield write


def check_spad512_size(rows: int, columns: int) -> None:
    """Make sure that frames are of the camera's size. Raises ValueError."""
    if (rows, columns) != (SPAD512_PIXELS, SPAD512_PIXELS):
        raise ValueError(
            f"frames of {columns} × {rows} pixels; files of the SPAD512S have 512 × 512: set the "
            "camera's width and height to 512, or write binary_npy"
        )


def read_spad512(
    path: str | Path,
    layout: PackedLayout | None = None,
    *,
    first: int = 0,
    frames: int | None = None,
) -> RecordedFrames:
    """Read a file, or all of a folder. Raises ValueError as `read_frames`."""
    path, layout, pixels = Path(path), layout or PackedLayout(), SPAD512_PIXELS
    raw = raw_frames(path, pixels * pixels // 8, layout, first, frames)
    is_wide = layout.packed_along == "width"
    packed = raw.reshape(-1, *((pixels, pixels // 8) if is_wide else (pixels // 8, pixels)))
    bits = unpack_frames(packed, layout, path, None)
    return RecordedFrames(counts=bits, bit_depth=1, exposure_s=None, source="spad512")
