"""A view, side by side: light, readings, the motion by a method, the true motion.

It shows a dataset of one sequence, a recording, or a file of frames or events. Missing parts are
omitted.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from megalopta.core.arrays import Floats
from megalopta.report.panels import (
    Panel,
    readings_panel,
)
from megalopta.report.readings import Treatment, readings_of
from megalopta.sensor.formats.reading import FrameKind

if TYPE_CHECKING:
    from megalopta.dataset.sequence import Sequence

LONGEST_SIDE_PX = 320


@dataclass(frozen=True, eq=False)
class Exposed:
    """Readings of one sensor at one light level, and the motion estimated from them."""

    readings: Panel
    flow: Panel | None = None
    sensor: str = ""
    level: str = ""


@dataclass(frozen=True, eq=False, kw_only=True)
class Seen:
    """Content of a view."""

    title: str
    summary: str
    shape: tuple[int, int]
    frames: range
    """Frames that can be shown, by number"""
    step: int
    """Step between the drawn pixels of a line."""
    times_s: Floats | None
    """Start of each frame, if known"""
    treatment: Treatment
    light: Panel | None = None
    exposed: tuple[Exposed, ...] = ()
    """The darkest light of a sensor first"""
    motion: Panel | None = None
    """The true motion, or its stand-in"""
    rim: float | None = None
    """Speed of the full color, px per frame, if there is flow"""
    sequence: "Sequence | None" = None

    @property
    def rate_hz(self) -> float | None:
        """Real frame rate of the frames that can be shown, if known."""
        times = self.times_s
        if times is None or len(times) < 2 or times[-1] <= times[0]:
            return None
        return float((len(times) - 1) / (times[-1] - times[0])) / self.frames.step


def seen_readings(thing: Path, treatment: Treatment, kind: FrameKind | None = None) -> Seen:
    """Return the view of a recording, or of a file or folder of frames or events.

    Raises UserError if it is none of these, is damaged, or does not allow the treatment.
    """
    readings = readings_of(thing, kind).treated(treatment)
    total, rows, columns = readings.shape[:3]
    frames = range(0, total - treatment.summed + 1, treatment.summed)
    step = step_of((rows, columns))
    what = "binary frames" if readings.is_binary else "frames"
    return Seen(
        title=thing.resolve().name,
        summary=f"{total} {what} of {columns} × {rows} pixels.",
        shape=(rows, columns),
        frames=frames,
        step=step,
        times_s=readings.times_s,
        treatment=treatment,
        exposed=(Exposed(readings_panel(readings, frames, step)),),
    )


def step_of(shape: tuple[int, int]) -> int:
    """Return the step between the shown pixels of a line."""
    return math.ceil(max(shape) / LONGEST_SIDE_PX)
