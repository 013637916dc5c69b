"""Frames as returned by every reader; opening and creating files; stacks in TIFF."""

import logging
import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import tifffile
from numpy.typing import NDArray

from megalopta.core import bounded
from megalopta.core.files import atomic_write, natural_key
from megalopta.sensor.formats.conditions import Conditions, conditions_in

Values: TypeAlias = Literal["counts", "bits"]
ZEROS_AND_ONES = "all values are 0 or 1"


@dataclass(frozen=True, eq=False)
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
    conditions: Conditions = field(default_factory=dict)
    """Conditions that the file itself states"""
    basis: str = "by its format"
    """How counts and bits were distinguished"""

    @property
    def values(self) -> Values:
        """Counts, or bits."""
        return "bits" if self.bit_depth == 1 else "counts"

    @property
    def exposure_s(self) -> float | None:
        """Exposure time of a frame, s, if the file states it."""
        return self.conditions.get("exposure_s")


@dataclass(frozen=True, eq=False)
class Stack:
    """An open recording."""

    source: str
    total: int
    frame_bytes: float
    """Memory of a frame (bytes)"""
    read: Callable[[slice], NDArray[Any]]
    """Reads frames from a first to before a last one, (n, H, W)"""
    bits: int | None = None
    """Bits of a count as the format states them; None: counts or bits, as the numbers tell"""
    conditions: Conditions = field(default_factory=dict)

    def frames(self, path: Path, frames: slice, values: Values | None = None) -> RecordedFrames:
        """Return consecutive frames.

        Unless the format or `values` state it, they are bits if they are booleans, or if some
        frames of the whole recording hold only 0 and 255, 0 and 65535, or in 8 bits 0 and 1. Raises
        ValueError for counts below 0, for bits that are more than two numbers, and if there are
        fewer frames; UserError if they take too much memory.
        """
        first, end = frames.start or 0, self.total if frames.stop is None else frames.stop
        if not 0 <= first <= end <= self.total:
            what = f"frames {first} to {end - 1} are requested"
            raise ValueError(f"{path}: {what}; it has {self.total}")
        bounded.check_decoded(path, (end - first,), 2 * self.frame_bytes)  # decoded, and copied
        numbers = self.read(slice(first, end))
        if self.bits is not None:
            return RecordedFrames(numbers, self.bits, self.source, self.total, self.conditions)
        if numbers.dtype.kind == "i" and numbers.min(initial=0) < 0:
            raise ValueError(f"{path}: has counts below 0; give raw counts")
        # 16 frames tell counts from bits where only a part is read
        is_part, spacing = len(numbers) < self.total, -(-self.total // 16)
        sampled = range(0, self.total, spacing) if is_part else ()
        seen = [numbers, *(self.read(slice(at, at + 1)) for at in sampled)]
        most = max(part.max(initial=0) for part in seen)
        is_two = all(((frame == 0) | (frame == most)).all() for part in seen for frame in part)
        is_full = most in (255, 65535) or (most <= 1 and numbers.itemsize == 1)
        are_bits, basis = False, f"values up to {most:g}"
        if values:
            are_bits, basis = values == "bits", "as stated"
        elif numbers.dtype == np.bool_:
            are_bits, basis = True, "by its type"
        elif is_two and is_full and numbers.dtype.kind in "ui":
            are_bits, basis = True, f"all values are 0 or {max(most, 1)}"
        if are_bits and not is_two:
            raise ValueError(f"{path}: values up to {most:g}, no bits; state values: counts")
        bits = 1 if are_bits else 8 * numbers.itemsize
        counts = (numbers != 0).view(np.uint8) if are_bits else numbers
        return RecordedFrames(counts, bits, self.source, self.total, self.conditions, basis)


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


def parts_in(path: Path, *suffixes: str) -> list[Path]:
    """Return files of a folder by their suffixes, in natural order, or a file itself.

    Raises ValueError for a link among them.
    """
    if not path.is_dir():
        return [path]
    parts = [part for part in path.iterdir() if part.suffix.lower() in suffixes]
    if links := [part for part in parts if part.is_symlink()]:
        raise ValueError(f"{links[0]}: a link in a recording; remove it")
    return sorted((part for part in parts if part.name[0] != "."), key=natural_key)


_MOST_PAGES = 100_000
_VALUE_BYTES = 24
"""Memory of a value of frames that are shown, besides the frames (bytes, measured)."""
# Largest expansion of a deflate stream: a file does not justify more memory than that.
_LARGEST_EXPANSION = 1032


@contextmanager
def tiff_writer(
    path: str | Path, total_bytes: int, exposure_s: float | None = None
) -> Iterator[Callable[[NDArray[Any]], None]]:
    """Yield a function that appends frames (T, H, W); the file appears when the writer exits.

    `total_bytes` is the approximate size of all frames; `exposure_s` the exposure time, s.
    """
    is_big = total_bytes > 4 * 10**9  # bytes, above which a TIFF is a BigTIFF
    metadata = {} if exposure_s is None else {"exposure_s": exposure_s}
    with (
        atomic_write(Path(path)) as temporary,
        tifffile.TiffWriter(temporary, bigtiff=is_big) as file,
    ):

        def write(frames: NDArray[Any]) -> None:
            for frame in frames:
                file.write(frame, contiguous=True, photometric="minisblack", metadata=metadata)

        yield write


@contextmanager
def opened_tiff(path: Path) -> Iterator[Stack]:
    """Open the first stack of a file, (T, H, W); raises as `read_frames`."""
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
        if stack.ndim not in (2, 3) or stack.dtype.kind not in "buif" or "S" in stack.axes:
            raise ValueError(
                f"{path}: {stack.dtype} {stack.shape}; give a stack of gray frames (T, H, W)"
            )
        total = len(pages) if len(pages) > 1 or stack.ndim == 2 else stack.shape[0]
        frame_bytes = math.prod(stack.shape[-2:]) * (stack.dtype.itemsize + _VALUE_BYTES) / 2

        decoded = cache(stack.asarray)

        def read(part: slice) -> NDArray[Any]:
            if len(pages) == total:
                images = [page.asarray() for page in pages[part]]
                return np.array(images, stack.dtype).reshape(-1, *stack.shape[-2:])
            bounded.check_decoded(path, stack.shape, stack.dtype.itemsize)
            return np.asarray(decoded()[part])

        text = str(getattr(file.pages[0], "description", ""))[: bounded.QUOTED]
        yield Stack("tiff", total, frame_bytes, read, conditions=conditions_in(text))


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
