"""Frames as returned by every reader; opening and creating files; stacks in TIFF."""

import json
import logging
import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from megalopta.core import bounded
from megalopta.core.files import atomic_write


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
        bounded.check_file(path, sys.maxsize)
        if path.stat().st_size == 0:
            raise ValueError(f"{path}: the file is empty; copy it again")
        return np.memmap(path, np.uint8, "r")
    except OSError as problem:
        reason = (problem.strerror or str(problem)).lower()
        raise ValueError(f"{path}: cannot be read ({reason}); give a file") from None


def wanted(total: int, frames: slice, path: Path, frame_bytes: float) -> slice:
    """Return the requested range of frames, of so many bytes each in memory.

    Raises ValueError if the file has fewer; UserError if they take too much memory.
    """
    first, end = frames.start or 0, total if frames.stop is None else frames.stop
    if not 0 <= first <= end <= total:
        raise ValueError(f"{path}: frames {first} to {end - 1} are requested; it has {total}")
    bounded.check_decoded(path, (end - first,), 2 * frame_bytes)  # decoded, and copied
    return slice(first, end)


_MOST_PAGES = 100_000
_VALUE_BYTES = 24
"""Memory of a value of frames that are shown, besides the frames (bytes, measured)."""
_LARGEST_TIFF = 4 * 10**9
# Largest expansion of a deflate stream: a file does not justify more memory than that.
_LARGEST_EXPANSION = 1032


@contextmanager
def tiff_writer(
    path: str | Path, total_bytes: int, exposure_s: float | None = None
) -> Iterator[Callable[[NDArray[Any]], None]]:
    """Yield a function that appends frames (T, H, W); the file appears when the writer exits.

    `total_bytes` is the approximate size of all frames; `exposure_s` the exposure time, s.
    """
    is_big = total_bytes > _LARGEST_TIFF
    metadata = {} if exposure_s is None else {"exposure_s": exposure_s}
    with (
        atomic_write(Path(path)) as temporary,
        tifffile.TiffWriter(temporary, bigtiff=is_big) as file,
    ):

        def write(frames: NDArray[Any]) -> None:
            for frame in frames:
                file.write(frame, contiguous=True, photometric="minisblack", metadata=metadata)

        yield write


def read_tiff(path: Path, frames: slice) -> RecordedFrames:
    """Read the first stack of a file, (T, H, W); raises as `read_frames`."""
    size = file_bytes(path).size
    with bounded.undamaged(path), _complaining(), tifffile.TiffFile(path) as file:
        with suppress(IndexError):
            file.pages[_MOST_PAGES]  # the number of pages would be counted one by one
            bounded.check_count(path, "pages", len(file.pages), _MOST_PAGES)
        stack = file.series[0]
        pages = [page for page in stack.pages if page is not None]
        expansion = 1 if pages[0].compression == 1 else _LARGEST_EXPANSION
        ends = (
            start + count
            for part in pages
            for start, count in zip(part.dataoffsets, part.databytecounts, strict=True)
        )
        if stack.nbytes > size * expansion or max(ends, default=0) > size:
            raise ValueError(
                f"{path}: states {stack.nbytes} bytes of frames, more than its {size} can hold; it "
                "is cut short or damaged: copy it again"
            )
        if stack.ndim not in (2, 3) or stack.dtype.kind not in "uif" or "S" in stack.axes:
            raise ValueError(
                f"{path}: {stack.dtype} {stack.shape}; give a stack of gray frames (T, H, W)"
            )
        total = len(pages) if len(pages) > 1 or stack.ndim == 2 else stack.shape[0]
        frame_bytes = math.prod(stack.shape[-2:]) * (stack.dtype.itemsize + _VALUE_BYTES) / 2
        range_ = wanted(total, frames, path, frame_bytes)
        if len(pages) == total:
            images = [file_page.asarray() for file_page in pages[range_]]
            counts = np.array(images).reshape(-1, *stack.shape[-2:])
        else:
            bounded.check_decoded(path, stack.shape, stack.dtype.itemsize)
            counts = stack.asarray()[range_]
        exposure_s = _exposure_s(file)
    depth = 8 * counts.dtype.itemsize
    return RecordedFrames(
        counts=counts, bit_depth=depth, exposure_s=exposure_s, source="tiff", total=total
    )


class _Complaint(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        raise ValueError(record.getMessage())


@contextmanager
def _complaining() -> Iterator[None]:
    """Raise what tifffile only logs, such as a chain of pages that is cut, as ValueError."""
    log, complaint = logging.getLogger("tifffile"), _Complaint(logging.ERROR)
    log.addHandler(complaint)
    try:
        yield
    finally:
        log.removeHandler(complaint)


def _exposure_s(file: Any) -> float | None:
    try:
        found = json.loads(file.pages[0].description).get("exposure_s")
    except (ValueError, AttributeError):
        return None
    return float(found) if isinstance(found, int | float) and found > 0 else None
