"""What an event file holds, and its numbers: picoseconds, columns and rows.

An event is 12 bytes: `t`, int64, picoseconds from the beginning of the sequence, where frame n
begins at n times the frame's period; `x` and `y`, uint16, column and row. Events are sorted by
frame and time stamp. `starts` tells which events are a frame's, as a stamp that is shaken by jitter
may lie outside of it. A time stamp is rounded to a picosecond, far below the jitter of any SPAD.
"""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.format_numbers import check_format, written
from megalopta.sensor.events import Events

PICOSECONDS = 1e12
MOST_PIXELS_A_SIDE = 65536
_NUMBERS = ("frames", "height", "width", "first_frame", "frame_period_ps")


@dataclass(frozen=True, kw_only=True)
class EventOrigin:
    """Of which frames the events of a file are.

    Attributes
    ----------
    shape : (frames, rows, columns)
    frame_period_s : float
        From the beginning of a frame to that of the next, s; kept to a picosecond.
    exposure_s : float
        Exposure time of a frame, s.
    first_frame : int
        Number in the sequence of the first frame.
    extra : mapping
        Whatever else the writer notes; JSON values.
    """

    shape: tuple[int, int, int]
    frame_period_s: float
    exposure_s: float
    first_frame: int = 0
    extra: Mapping[str, Any] = field(default_factory=dict)

    @property
    def period_ps(self) -> int:
        """Frame period in whole picoseconds."""
        return round(self.frame_period_s * PICOSECONDS)

    def attributes(self) -> dict[str, Any]:
        """What a file tells of its origin."""
        frames, height, width = self.shape
        return {
            "version": written("events"),
            "frames": frames,
            "height": height,
            "width": width,
            "first_frame": self.first_frame,
            "frame_period_ps": self.period_ps,
            "exposure_s": self.exposure_s,
            "extra": json.dumps(dict(self.extra)),
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class StoredEvents:
    """Events of a file, and of which frames they are."""

    events: Events
    origin: EventOrigin


def check_frames(path: str | Path, written: int, origin: EventOrigin) -> None:
    """Make sure that all frames of a file were written. Raises ValueError."""
    if written != origin.shape[0]:
        raise ValueError(f"{path}: {written} frames were written of {origin.shape[0]}")


@contextmanager
def damage_told(path: Path) -> Iterator[None]:
    """Whatever reading a damaged file raises is a ValueError of one sentence."""
    try:
        yield
    except Exception as problem:
        reason = " ".join(str(problem).split())[:160]
        raise ValueError(f"{path}: damaged, cut short or another file ({reason})") from None


def columns_of(
    events: Events, origin: EventOrigin
) -> tuple[NDArray[np.int64], NDArray[np.uint16], NDArray[np.uint16]]:
    """Numbers `t`, `x` and `y` that are stored of events.

    Raises
    ------
    ValueError
        When the events are of other frames than a file of this origin.
    """
    last = events.first_frame + events.shape[0]
    end = origin.first_frame + origin.shape[0]
    if events.shape[1:] != origin.shape[1:] or not origin.first_frame <= events.first_frame <= end:
        raise ValueError(
            f"events of frames {events.first_frame} to {last - 1}, {events.shape[1:]} pixels; the "
            f"file is for {origin.first_frame} to {end - 1}, {origin.shape[1:]} pixels"
        )
    if max(origin.shape[1:]) > MOST_PIXELS_A_SIDE:
        raise ValueError(f"{origin.shape[1:]} pixels; an event file has up to 65536 a side")
    t = np.rint(events.time_s * PICOSECONDS).astype(np.int64)
    numbers = np.arange(events.first_frame, last, dtype=np.int64)
    t += np.repeat(numbers * origin.period_ps, np.diff(events.starts))
    columns = np.uint32(max(origin.shape[2], 1))
    y = events.pixel // columns
    return t, (events.pixel - y * columns).astype(np.uint16), y.astype(np.uint16)


def stored_events(
    path: Path,
    attributes: Mapping[str, Any],
    t: NDArray[np.int64],
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    starts: NDArray[np.int64],
) -> StoredEvents:
    """Events of the numbers of a file.

    Raises
    ------
    ValueError
        When they do not fit together.
    UserError
        When another version of the program wrote them, whose format this one does not read.
    """
    try:
        version = int(attributes.get("version", 0))
        check_format("events", {"version": version}, path, key="version")
        origin = _origin(attributes)
        _check_numbers(origin, t, x, y, starts)
    except (KeyError, TypeError, ValueError, OverflowError) as problem:
        reason = f"lacks {problem}" if isinstance(problem, KeyError) else str(problem)
        raise ValueError(f"{path}: damaged ({reason}); write or copy it again") from None
    numbers = np.arange(origin.first_frame, origin.first_frame + origin.shape[0], dtype=np.int64)
    local = t - np.repeat(numbers * origin.period_ps, np.diff(starts))
    pixel = y.astype(np.uint32) * np.uint32(origin.shape[2]) + x
    events = Events(local / PICOSECONDS, pixel, starts, origin.shape, origin.first_frame)
    return StoredEvents(events=events, origin=origin)


def _origin(attributes: Mapping[str, Any]) -> EventOrigin:
    frames, height, width, first_frame, period_ps = (int(attributes[name]) for name in _NUMBERS)
    exposure_s = float(attributes["exposure_s"])
    if min(frames, height, width, first_frame) < 0 or period_ps < 0 or not exposure_s > 0:
        raise ValueError(f"{frames} frames of {height} × {width} pixels, exposed {exposure_s} s")
    extra = json.loads(attributes["extra"])
    return EventOrigin(
        shape=(frames, height, width),
        frame_period_s=period_ps / PICOSECONDS,
        exposure_s=exposure_s,
        first_frame=first_frame,
        extra=dict(extra),
    )


def _check_numbers(
    origin: EventOrigin,
    t: NDArray[np.int64],
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    starts: NDArray[np.int64],
) -> None:
    if not len(t) == len(x) == len(y):
        raise ValueError(f"{len(t)} times, {len(x)} columns and {len(y)} rows")
    frames, height, width = origin.shape
    if len(starts) != frames + 1 or starts[0] != 0 or starts[-1] != len(t):
        raise ValueError(f"starts do not share {len(t)} events among {frames} frames")
    if np.any(np.diff(starts) < 0):
        raise ValueError("starts decrease")
    if t.size and (x.max() >= width or y.max() >= height):
        raise ValueError(f"a pixel outside of {height} × {width}")
    backward = np.flatnonzero(np.diff(t) < 0) + 1
    if not np.isin(backward, starts).all():
        raise ValueError("times that decrease within a frame")
