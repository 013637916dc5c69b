"""Raw binary frames of SwissSPAD2: `.bin` files of 512 half frames or 256 whole ones, 8 MiB each.

No header, and the least significant bit of a byte is the first pixel. A half frame is 256 × 512. A
whole one, 512 × 512, is 256 lines of 128 bytes: a quarter of a row of the top half, the same
quarter of a row of the bottom half, counted from below, the next quarter of the top, and so on.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from megalopta.sensor.formats.layout import PackedLayout, unpack_frames
from megalopta.sensor.formats.raw_bits import raw_frames
from megalopta.sensor.formats.recorded_frames import RecordedFrames

_ROWS, _COLUMNS, _QUARTERS = 256, 512, 4
_LAYOUT = PackedLayout(bit_order="lsb")


def read_swissspad2(
    path: str | Path,
    layout: PackedLayout | None = None,
    *,
    is_whole: bool = False,
    first: int = 0,
    frames: int | None = None,
) -> RecordedFrames:
    """Read a file, or all of a folder; of half frames, or whole ones.

    Raises
    ------
    FileNotFoundError
        When there is nothing.
    ValueError
        When a file is cut short or its bits seem to be in another order.
    """
    path, layout = Path(path), layout or _LAYOUT
    frame_bytes = (1 + is_whole) * _ROWS * _COLUMNS // 8
    raw = raw_frames(path, frame_bytes, layout, first, frames)
    packed = _whole(raw) if is_whole else raw.reshape(-1, _ROWS, _COLUMNS // 8)
    bits = unpack_frames(packed, layout, path, None)
    source = "swissspad2_whole" if is_whole else "swissspad2"
    return RecordedFrames(counts=bits, bit_depth=1, exposure_s=None, source=source)


def _whole(raw: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Both halves of frames, (T, 512, 64)."""
    quarters = raw.reshape(-1, _ROWS, _QUARTERS, 2, _COLUMNS // 8 // _QUARTERS)
    halves = np.moveaxis(quarters, 3, 1).reshape(-1, 2, _ROWS, _COLUMNS // 8)
    return np.concatenate([halves[:, 0], halves[:, 1, ::-1]], axis=1)
