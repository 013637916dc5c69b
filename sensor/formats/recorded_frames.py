"""What every reader of frames returns."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.bounded import check_file


@dataclass(frozen=True, eq=False, kw_only=True)
class RecordedFrames:
    """Frames of a file.

    Attributes
    ----------
    counts : (T, H, W) or (T, H, W, C) array
        Counts, or bits as 0 and 1, uint8.
    bit_depth : int
        Of the counts; 1 of binary frames.
    exposure_s : float or None
        Exposure time of a frame, where the file says it, s.
    source : str
        Name of the format.
    """

    counts: NDArray[Any]
    bit_depth: int
    exposure_s: float | None
    source: str


def file_bytes(path: Path) -> NDArray[np.uint8]:
    """Bytes of a file, (N,), read from the disk where they are used.

    Raises
    ------
    FileNotFoundError
        When there is no such file.
    ValueError
        When it is empty or cannot be read.
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


def wanted(total: int, first: int, frames: int | None, path: Path) -> slice:
    """Range of so many frames from a number on, of a file with a total.

    Raises
    ------
    ValueError
        When the file has fewer.
    """
    end = total if frames is None else first + frames
    if not 0 <= first <= end <= total:
        raise ValueError(f"{path}: frames {first} to {end - 1} are asked for; it has {total}")
    return slice(first, end)
