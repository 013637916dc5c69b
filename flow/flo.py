"""Middlebury .flo files: the tag "PIEH", width and height as int32, then (u, v) float32 by rows.

Everything is little-endian. An undefined flow is stored as 1e10 in both components, and whatever
exceeds 1e9 in either is read back as NaN in both (Baker et al., IJCV 92, 2011, flowIO of the
Middlebury evaluation). A file appears whole or not at all.
"""

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from megalopta.core.bounded import ARRAY_BYTES, read_bytes
from megalopta.core.files import atomic_write

TAG = b"PIEH"
UNKNOWN = 1e10
LARGEST_KNOWN = 1e9
_HEADER = struct.Struct("<4sii")
_LARGEST_SIDE = 100_000


def write_flo(path: str | Path, flow: NDArray[np.floating]) -> None:
    """Write a flow (H, W, 2), px, +x right, +y down, NaN where undefined.

    Raises
    ------
    ValueError
        When the array is no flow, or holds a value that would be read as undefined.
    """
    check_flow(flow)
    if max(flow.shape[:2]) > _LARGEST_SIDE:
        raise ValueError(f"flow of shape {flow.shape}: a side may have {_LARGEST_SIDE} px at most")
    if np.any(np.abs(flow) > LARGEST_KNOWN):
        raise ValueError(
            f"flow exceeds {LARGEST_KNOWN:g} px, which .flo keeps for undefined: store NaN instead"
        )
    undefined = np.isnan(flow).any(axis=-1, keepdims=True)
    values = np.where(undefined, UNKNOWN, flow).astype("<f4")
    height, width = flow.shape[:2]
    with atomic_write(Path(path)) as temporary:
        temporary.write_bytes(_HEADER.pack(TAG, width, height) + values.tobytes())


def read_flo(path: str | Path) -> NDArray[np.float32]:
    """Read a flow (H, W, 2), px, +x right, +y down, NaN where undefined.

    Raises
    ------
    ValueError
        When the file is not a whole .flo file.
    """
    content = read_bytes(path, ARRAY_BYTES)
    if len(content) < _HEADER.size:
        raise ValueError(f"{path} has {len(content)} bytes: too short for a .flo file")
    tag, width, height = _HEADER.unpack_from(content)
    if tag != TAG:
        raise ValueError(f"{path} starts with {tag!r}: a .flo file starts with {TAG!r}")
    if not (0 < width <= _LARGEST_SIDE and 0 < height <= _LARGEST_SIDE):
        raise ValueError(f"{path} claims {width} × {height} px: the file is damaged")
    expected = _HEADER.size + 8 * width * height
    if len(content) != expected:
        raise ValueError(
            f"{path} has {len(content)} bytes, {width} × {height} px need {expected}: the file is"
            " damaged"
        )
    stored = np.frombuffer(content, "<f4", offset=_HEADER.size).reshape(height, width, 2)
    known = (np.abs(stored) <= LARGEST_KNOWN).all(axis=-1, keepdims=True)
    return np.where(known, stored, np.float32(np.nan)).astype(np.float32)


def check_flow(flow: NDArray[np.floating]) -> None:
    """Refuse, with ValueError, what is no flow (H, W, 2) of one pixel or more."""
    if flow.ndim != 3 or flow.shape[-1] != 2 or 0 in flow.shape:
        raise ValueError(f"flow of shape {flow.shape}: give (H, W, 2)")
