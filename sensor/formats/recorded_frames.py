"""Frames as returned by every reader; opening and creating files."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.bounded import check_decoded, check_file


@dataclass(frozen=True, eq=False, kw_only=True)
class RecordedFrames:
    """Frames of a file."""

    counts: NDArray[Any]
    """(T, H, W) or (T, H, W, C): counts, or bits as 0 and 1, uint8"""
    bit_depth: int
    """Bits per count; 1 for binary frames"""
    source: str
    """Name of the format, as `read_frames` takes it"""
    total: int
    """Number of frames in the file, of which fewer may have been requested"""
    exposure_s: float | None = None
    """Exposure time of a frame, s, if the file states it"""


def file_bytes(path: Path) -> NDArray[np.uint8]:
    """Return the bytes of a file, (N,), memory-mapped.

    Raises FileNotFoundError if there is no such file, ValueError if it is empty or unreadable.
    """
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file; give the path of a recording")
    try:
        check_file(path, sys.maxsize)
        if path.stat().st_size == 0:
            raise ValueError(f"{path}: the file is empty; copy it again")
        return np.memmap(path, np.uint8, "r")
    except OSError as problem:
        reason = (problem.strerror or str(problem)).lower()
        raise ValueError(f"{path}: cannot be read ({reason}); give a file") from None


def check_new(path: Path) -> None:
    """Raise FileExistsError if the path exists."""
    if path.exists():
        raise FileExistsError(f"{path}: already exists; remove it or choose another name")


def wanted(total: int, frames: slice, path: Path, frame_bytes: float) -> slice:
    """Return the requested range of frames, of so many bytes each in memory.

    Raises ValueError if the file has fewer; UserError if they take too much memory.
    """
    first, end = frames.start or 0, total if frames.stop is None else frames.stop
    if not 0 <= first <= end <= total:
        raise ValueError(f"{path}: frames {first} to {end - 1} are requested; it has {total}")
    check_decoded(path, (end - first,), 2 * frame_bytes)  # decoded, and copied
    return slice(first, end)
