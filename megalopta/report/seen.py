"""What is seen of a thing, side by side: light, readings, the motion that a method found, the true.

The thing is a dataset of one sequence, a recording, or a file of frames or events. What it lacks is
not shown.
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
    """Readings of one sensor at one light level, and the motion found in them."""

    readings: Panel
    flow: Panel | None = None
    sensor: str = ""
    level: str = ""


@dataclass(frozen=True, eq=False, kw_only=True)
class Seen:
    """What is seen of a thing."""

    title: str
    summary: str
    shape: tuple[int, int]
    frames: range
    """Those that can be shown, by number"""
    step: int
    """Every so many-th pixel of a line is drawn."""
    times_s: Floats | None
    """When each frame begins, where it is known"""
    treatment: Treatment
    light: Panel | None = None
    exposed: tuple[Exposed, ...] = ()
    """The darkest light of a sensor first"""
    motion: Panel | None = None
    """The true one, or what stands in for it"""
    rim: float | None = None
    """Speed of the full color, px a frame, where there is flow"""
    sequence: "Sequence | None" = None

    @property
    def rate_hz(self) -> float | None:
        """Frames a second in life of those that can be shown, where it is known."""
        times = self.times_s
        if times is None or len(times) < 2 or times[-1] <= times[0]:
            return None
        return float((len(times) - 1) / (times[-1] - times[0])) / self.frames.step


def seen_readings(thing: Path, treatment: Treatment, kind: FrameKind | None = None) -> Seen:
    """Return what is seen of a recording, or of a file or folder of frames or events.

    Raises UserError where it is none, is damaged, or cannot be treated so.
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
    """Return which pixels of a line are shown: every so many-th."""
    return math.ceil(max(shape) / LONGEST_SIDE_PX)
