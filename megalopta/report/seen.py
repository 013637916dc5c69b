"""What is seen of a thing, side by side: light, readings, the motion that a method found, the true.

The thing is a dataset of one sequence, a recording, or a file of frames or events. What it lacks is
not shown.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from numpy.typing import NDArray

from megalopta.config.model import LightLevel
from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError
from megalopta.dataset.opened import open_dataset
from megalopta.dataset.sequence import Sequence
from megalopta.dataset.store import exposure_name
from megalopta.flow.detectors.registry import velocity_method
from megalopta.plotting.text import level_name
from megalopta.report.page import title
from megalopta.report.panels import (
    Panel,
    best_method,
    exposure_readings,
    fastest_of,
    flow_panel,
    found_flow,
    light_panel,
    motion_of,
    readings_panel,
)
from megalopta.report.readings import Treatment, readings_of
from megalopta.report.source import finished_stages, read_records, spread
from megalopta.scenes.lighting.levels import illuminance_of
from megalopta.sensor import ImageSensor, StoredFrames
from megalopta.sensor.formats.reading import FrameKind
from megalopta.stages.flow import responses_path
from megalopta.stages.ledger import Ledger

FlowOf: TypeAlias = Callable[[int], NDArray[Any]]
"""Flow (h, w, 2) of a frame, px"""

_LONGEST_SIDE_PX = 320
_CAVEAT = " Their true motion is not known; the flow of the clean pictures stands in for it."
_SAMPLED = 8
"""Frames, spread evenly, that the speed of the full color is taken from"""


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
    sequence: Sequence | None = None

    @property
    def rate_hz(self) -> float | None:
        """Frames a second in life of those that can be shown, where it is known."""
        times = self.times_s
        if times is None or len(times) < 2 or times[-1] <= times[0]:
            return None
        return float((len(times) - 1) / (times[-1] - times[0])) / self.frames.step


def seen(thing: Path, treatment: Treatment, kind: FrameKind | None = None) -> Seen:
    """Return what is seen of a thing.

    Raises UserError where it is nothing that can be seen, is damaged, or cannot be treated so.
    """
    if (thing / "dataset.yaml").exists():
        return _Shown(open_dataset(thing)[0], treatment).seen()
    readings = readings_of(thing, kind).treated(treatment)
    total, rows, columns = readings.shape[:3]
    frames, step = range(0, total - treatment.summed + 1, treatment.summed), _step((rows, columns))
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


def _step(shape: tuple[int, int]) -> int:
    return math.ceil(max(shape) / _LONGEST_SIDE_PX)


class _Shown:
    """A dataset of one sequence, as far as its stages are finished."""

    def __init__(self, sequence: Sequence, treatment: Treatment) -> None:
        self.sequence, self.treatment = sequence, treatment
        settings, ledger = sequence.configuration, Ledger(sequence.dataset)
        if settings.scene.has_truth:
            ledger.require("render")
        finished = finished_stages(ledger)
        pairs = settings.exposures if "sense" in finished else ()
        self.pairs = sorted(pairs, key=lambda pair: illuminance_of(pair[1]))
        self.records = read_records(sequence.dataset) if "flow" in finished else []
        self.step = _step(sequence.shape)
        # the last frame has no successor, and so no motion
        end = min(len(sequence) - 1, len(sequence) - treatment.summed + 1)
        self.frames = range(0, max(end, 1), treatment.summed)

    def seen(self) -> Seen:
        """Return what is seen of it."""
        sequence, settings = self.sequence, self.sequence.configuration
        has_motion, (height, width) = len(sequence) > 1, sequence.shape
        rim = fastest_of(map(self._motion, spread(self.frames, _SAMPLED))) if has_motion else None
        name, caveat = "true flow", ""
        if not settings.scene.has_truth:
            name, caveat = "flow of the clean pictures", _CAVEAT
        return Seen(
            title=title(settings),
            summary=f"{len(sequence)} frames of {width} × {height} pixels.{caveat}",
            shape=sequence.shape,
            frames=self.frames,
            step=self.step,
            times_s=sequence.times_s,
            treatment=self.treatment,
            light=light_panel(sequence, self.frames, self.step),
            exposed=tuple(self._exposed(*pair, rim) for pair in self.pairs),
            motion=flow_panel(name, self._motion, rim) if rim else None,
            rim=rim,
            sequence=sequence,
        )

    def _motion(self, frame: int) -> NDArray[Any]:
        return motion_of(self.sequence, frame)[:: self.step, :: self.step]

    def _exposed(self, sensor: ImageSensor, level: LightLevel, rim: float | None) -> Exposed:
        readings = exposure_readings(self.sequence, exposure_name(sensor, level), sensor)
        drawn = readings_panel(readings.treated(self.treatment), self.frames, self.step)
        found = self._found(sensor, level)
        flow = flow_panel(f"flow by {found[0]}", found[1], rim) if found and rim else None
        return Exposed(drawn, flow, sensor.name, level_name(level))

    def _found(self, sensor: ImageSensor, level: LightLevel) -> tuple[str, FlowOf] | None:
        """Return the best method and the flow that it found in a frame; None where none ran."""
        own = [each for each in self.records if (each.sensor, each.level) == (sensor.name, level)]
        method = best_method(own)
        if method is None:
            return None
        path = responses_path(self.sequence.dataset, sensor, level)
        try:
            stored = StoredFrames.open(path, method)
        except (OSError, ValueError, KeyError) as problem:
            raise UserError(f"{path} cannot be read ({problem}); run flow again") from None
        grid = velocity_method(method).grid(self.sequence.shape)
        return method, lambda frame: found_flow(stored, grid, frame)[:: self.step, :: self.step]
