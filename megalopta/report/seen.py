"""A view, side by side: light, readings, the motion by a method, the true motion.

It shows a dataset of one sequence, a recording, or a file of frames or events. Missing parts are
omitted.
"""

import math
from collections.abc import Callable, Iterable, Sequence as Listed
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray
from PIL import Image

from megalopta.core.arrays import Floats
from megalopta.flow.color_wheel import flow_to_rgb
from megalopta.plotting.text import number, short
from megalopta.report.images import ColorScale, evenly_spaced, film, gray_scale, rgb_picture
from megalopta.report.readings import ShownReadings, Treatment, readings_of
from megalopta.sensor.formats.reading import FrameKind

if TYPE_CHECKING:
    from megalopta.dataset.sequence import Sequence

MOST_FRAMES = 80
"""Of a page"""
SAMPLED = 8
"""Frames, spread evenly, that scales of colors are taken from"""
WHITE_PERCENTILE = 99.0
"""Percentile of readings above which all are white"""
_GAMMA = 2.2
kept = lru_cache(maxsize=MOST_FRAMES)
"""Page and film draw the same pictures once, where there are no more."""


@dataclass(frozen=True, eq=False)
class Panel:
    """Pictures of one quantity, drawn when they are asked for."""

    kind: Literal["light", "readings", "flow", "motion", "depth"]
    """Flow is estimated from readings; motion is the true one, or its stand-in."""
    name: str
    caption: str
    """Meaning of its colors"""
    picture: Callable[[int], Image.Image]
    """Returns the picture of a frame, by its number"""
    legend: Markup = field(default=Markup(""))
    note: str = ""
    """Note on a special color, for a film, which has no legend"""
    sensor: str = ""
    level: str = ""
    """Sensor and light level of readings, and of the flow from them; empty of a file"""


def readings_panel(
    readings: ShownReadings,
    frames: Listed[int],
    step: int,
    white_percentile: float = WHITE_PERCENTILE,
) -> Panel:
    """Return readings as grays, saturated pixels in orange; some of the frames give the white."""
    sampled = [readings.frame(each) for each in evenly_spaced(frames, SAMPLED)]
    bright = np.percentile(np.stack([values for values, _ in sampled]), white_percentile)
    white = max(float(bright), 1e-6 if readings.treatment.is_inverted else 1.0)
    scale = gray_scale(white)

    def picture(frame: int) -> Image.Image:
        values, full = readings.frame(frame)
        values, full = values[::step, ::step], full[::step, ::step]
        return _colored(values, scale) if values.ndim > 2 else scale.picture(values, full)

    is_full = any(full.any() for _, full in sampled)
    unit = "detections" if readings.treatment.is_inverted else readings.unit
    return Panel(
        "readings",
        unit,
        f"black 0, white {number(white)} {unit}",
        kept(picture),
        scale.legend("0", f"≥ {short(white)} {unit}", "saturated" if is_full else ""),
        "orange: saturated pixels" if is_full else "",
    )


def flow_panel(
    kind: Literal["flow", "motion"],
    name: str,
    flow: Callable[[int], NDArray[np.floating]],
    fastest: float,
) -> Panel:
    """Return flow (h, w, 2) of frames as colors; the speed `fastest` has the full one."""
    caption = f"hue is direction (red to the right), full color {number(fastest)} px per frame"
    picture = kept(lambda frame: rgb_picture(flow_to_rgb(flow(frame), fastest)))
    return Panel(kind, name, caption, picture)


def film_of(panel: Panel, frames: Iterable[int], title: str = "") -> Markup:
    """Return frames of a panel as a film of a page; by default its title is the panel's name."""
    pictures = [panel.picture(each) for each in frames]
    what = f"{panel.name}, {panel.sensor}, {panel.level}" if title else panel.name
    return film(pictures, title or panel.name, f"{what}: {panel.caption}", panel.legend)


def _colored(values: Floats, scale: ColorScale) -> Image.Image:
    part = np.clip(values / scale.high, 0, 1) ** (1 / _GAMMA)
    return rgb_picture(np.rint(255 * part).astype(np.uint8))


LONGEST_SIDE_PX = 320


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
    panels: tuple[Panel, ...]
    """By kind: light, readings, flow, motion; the darkest light of a sensor first"""
    rim: float | None = None
    """Speed of the full color, px per frame, if there is flow"""
    sequence: "Sequence | None" = None

    def of(self, *kinds: str) -> list[Panel]:
        """Return the panels of these kinds."""
        return [each for each in self.panels if each.kind in kinds]

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
        panels=(readings_panel(readings, frames, step),),
    )


def step_of(shape: tuple[int, int]) -> int:
    """Return the step between the shown pixels of a line."""
    return math.ceil(max(shape) / LONGEST_SIDE_PX)
