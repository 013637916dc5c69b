"""Panels: pictures of one quantity, frame by frame, of a sequence or of a file of readings."""

import math
from collections.abc import Callable, Iterable, Sequence as Listed
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray
from PIL import Image
from pydantic import TypeAdapter

from megalopta.config.model import LightLevel
from megalopta.config.sensing import level_text
from megalopta.core import bounded
from megalopta.core.arrays import Floats
from megalopta.core.errors import shell_command
from megalopta.core.progress import say
from megalopta.core.quantities import number, short, with_error
from megalopta.dataset.flow_record import FlowRecord
from megalopta.dataset.opened import open_dataset
from megalopta.dataset.picture_light import clean_flow, light_of, photons_per_lux, resized
from megalopta.dataset.sequence import Sequence
from megalopta.dataset.store import exposure_name, open_sequence
from megalopta.flow import formats
from megalopta.flow.color_wheel import flow_to_rgb
from megalopta.flow.detectors.blocks import BlockDetector
from megalopta.flow.detectors.registry import METHODS, velocity_method
from megalopta.report import images, sections
from megalopta.report.readings import ShownReadings, Treatment, readings_of
from megalopta.report.text import level_name, title
from megalopta.scenes import Pictures, ToneCurve
from megalopta.scenes.levels import illuminance_of
from megalopta.scenes.spectra.color import encode_srgb, linear_srgb
from megalopta.sensor import ImageSensor, StoredFrames
from megalopta.sensor.formats.products import product_path
from megalopta.sensor.formats.reading import FrameKind
from megalopta.stages.flow import responses_path
from megalopta.stages.registry import STAGES
from megalopta.stages.run import finished, has_output, require
from megalopta.stages.sense import burst_frames

MOST_FRAMES = 80
"""Of a page"""
LONGEST_SIDE_PX = 320
_SAMPLED = 8
"""Frames, spread evenly, that scales of colors are taken from"""
_CAVEAT = " Their true motion is unknown; the flow of the clean pictures is a stand-in for it."

_Read = TypeVar("_Read")


@dataclass(frozen=True, eq=False)
class Panel:
    """Pictures of one quantity, drawn on demand."""

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

    def film(self, frames: Iterable[int], title: str = "") -> Markup:
        """Return frames as a film of a page; by default its title is the panel's name."""
        alt = f"{self.name}, {self.sensor}, {self.level}" if title else self.name
        pictures = [self.picture(frame) for frame in frames]
        return images.film(pictures, title or self.name, f"{alt}: {self.caption}", self.legend)


@dataclass(frozen=True, eq=False, kw_only=True)
class View:
    """Panels side by side, over the same frames."""

    title: str
    summary: str
    shape: tuple[int, int]
    frames: range
    """Frames that can be shown, by number"""
    step: int
    """Step between the drawn pixels of a line"""
    times_s: Floats | None
    """Start of each frame, if known"""
    treatment: Treatment
    panels: tuple[Panel, ...]
    """By kind: light, readings, flow, motion; the darkest light of a sensor first"""
    rim: float | None = None
    """Speed of the full color, px per frame, if there is flow"""
    burst: int = 1
    """Frames to each rendered one: binary frames, if there are bursts"""
    sequence: Sequence | None = None

    def of(self, *kinds: str) -> list[Panel]:
        """Return the panels of these kinds."""
        return [panel for panel in self.panels if panel.kind in kinds]

    def player(self, frames: Listed[int], fps: float | None = None) -> sections.Player:
        """Return the slider of some of the frames, in real time where that can be followed."""
        times, real_hz = self.times_s, None
        if times is not None and len(times) > 1 and times[-1] > times[0]:
            shown_s = (times[-1] - times[0]) / (len(times) - 1) * self.frames.step
            real_hz = float(len(frames) / len(self.frames) / shown_s)
        labels = [images.frame_label(frame, times, self.treatment.summed) for frame in frames]
        return sections.Player(labels, self.shape, real_hz, fps)


def rate_of(times_s: Floats | None) -> str:
    """Return the rate of frames, such as " at 97.7 kHz"; "" if it is not known."""
    if times_s is None or len(times_s) < 2 or times_s[-1] <= times_s[0]:
        return ""
    return f" at {with_error((len(times_s) - 1) / (times_s[-1] - times_s[0]), math.nan, 'Hz')}"


def file_view(path: Path, treatment: Treatment, kind: FrameKind | None = None) -> View:
    """Return the view of a recording, or of a file or folder of frames or events.

    Raises UserError if it is none of these, is damaged, or does not allow the treatment.
    """
    readings = readings_of(path, kind).treated(treatment)
    total, rows, columns = readings.shape[:3]
    frames = range(0, total - treatment.summed + 1, treatment.summed)
    step = math.ceil(max(rows, columns) / LONGEST_SIDE_PX)
    frame_kind = "binary frames" if readings.bits == 1 else "frames"
    rate = rate_of(readings.times_s)
    return View(
        title=path.resolve().name,
        summary=f"{total} {frame_kind} of {columns} × {rows} pixels{rate or ', at unknown times'}.",
        shape=(rows, columns), frames=frames, step=step, times_s=readings.times_s,
        treatment=treatment, panels=(readings_panel(readings, frames, step),),
    )  # fmt: skip


def sequence_view(root: Path, treatment: Treatment, name: str | None = None) -> View:
    """Return the view of a sequence of a dataset, by default the only, with its finished stages.

    Raises UserError if it is damaged, not rendered yet, or does not allow the treatment.
    """
    sequence = open_dataset(root)[name] if name else Sequence(open_sequence(root))
    settings, (height, width) = sequence.configuration, sequence.shape
    has_truth = settings.scene.has_truth
    if has_truth:
        require(sequence.dataset, "render")
    step = math.ceil(max(sequence.shape) / LONGEST_SIDE_PX)
    burst = burst_frames(settings) if "burst_npy" in settings.products else 1
    # the last frame has no next frame, and so no motion; of bursts, binary frames are summed
    of_rendered = treatment if burst == 1 else replace(treatment, summed=1)
    end = max(min(len(sequence) - 1, len(sequence) - of_rendered.summed + 1), 1)
    frames = range(0, end, of_rendered.summed)
    shown = SequencePanels(sequence, frames, step, of_rendered)
    exposures = settings.exposures if "sense" in shown.finished else ()
    darkest_first = sorted(exposures, key=lambda exposure: illuminance_of(exposure[1]))
    panels = [shown.light, *(shown.readings(*exposure) for exposure in darkest_first)]
    panels += filter(None, (shown.found_flow(*exposure) for exposure in darkest_first))
    if shown.rim:
        panels.append(shown.motion("true flow" if has_truth else "flow of the clean pictures"))
    caveat, times_s = "" if has_truth else _CAVEAT, sequence.times_s
    summary = f"{len(sequence)} frames of {width} × {height} pixels{rate_of(times_s)}"
    if burst > 1 and exposures:
        panels = [_held(panel, burst) for panel in panels]
        frames = range(0, burst * end - treatment.summed + 1, treatment.summed)
        bursts = []
        for (sensor, level), counts in zip(darkest_first, panels[1:], strict=False):
            path = product_path(sequence.dataset.counts(sensor, level), "burst_npy")
            panel = readings_panel(readings_of(path).treated(treatment), frames, step)
            bursts.append(replace(panel, name="burst", sensor=counts.sensor, level=counts.level))
        panels = [*panels[: 1 + len(bursts)], *bursts, *panels[1 + len(bursts) :]]
        bit_s = 1 / (burst * settings.trajectory.frame_rate_hz)
        times_s = np.add.outer(times_s, bit_s * np.arange(burst)).ravel()
        summary += f", {burst} binary frames in each{rate_of(times_s)}"
    return View(
        title=title(settings), summary=f"{summary}.{caveat}", shape=sequence.shape, frames=frames,
        step=step, times_s=times_s, treatment=treatment, panels=tuple(panels), rim=shown.rim,
        burst=burst if exposures else 1, sequence=sequence,
    )  # fmt: skip


def _held(panel: Panel, frames: int) -> Panel:
    """Return a panel whose pictures stay for so many frames."""
    return replace(panel, picture=lambda frame: panel.picture(frame // frames))


class SequencePanels:
    """Panels of finished stages of a sequence: some frames, every `step`-th pixel of a line.

    Eight of the frames set the scales of colors. Raises UserError on use of what is damaged.
    """

    def __init__(
        self, sequence: Sequence, frames: Listed[int], step: int, treatment: Treatment | None = None
    ) -> None:
        self.sequence, self.frames, self.step = sequence, frames, step
        self._treatment = treatment or Treatment()
        self._sampled = images.evenly_spaced(frames, _SAMPLED)

    @cached_property
    def finished(self) -> list[str]:
        """Finished stages; unfinished output, which is not shown, is reported."""
        dataset = self.sequence.dataset
        stages = finished(dataset)
        for stage in STAGES:
            if stage not in stages and has_output(dataset, stage):
                fault = "is not finished with this configuration, and not shown"
                say(f"{dataset.root}: stage {stage!r} {fault}")
        return stages

    @cached_property
    def records(self) -> list[FlowRecord]:
        """Errors of every method on every exposure; none without flow.

        Raises UserError if flow.json is damaged.
        """
        if "flow" not in self.finished:
            return []
        dataset = self.sequence.dataset
        remedy = f"run: {shell_command('flow', dataset.root, '--redo')}"
        check = TypeAdapter(list[FlowRecord]).validate_python
        return checked_json(dataset.result("flow.json"), check, remedy)

    @cached_property
    def rim(self) -> float | None:
        """Speed of the full color, px per frame; None without a second frame."""
        has_motion = len(self.sequence) > 1
        return images.fastest_of(map(self.motion_of, self._sampled)) if has_motion else None

    @cached_property
    def light(self) -> Panel:
        """Light that sensors see."""
        settings, bands = self.sequence.configuration, self.sequence.bands_nm
        white = settings.scene.white(settings.light)

        def linear(frame: int) -> Floats:
            return linear_srgb(self.pixels(self.sequence.radiance[frame]), bands, white)

        curve = ToneCurve.of(map(linear, self._sampled))
        caption = "as the eye would see it in bright light"

        @lru_cache(MOST_FRAMES)
        def picture(frame: int) -> Image.Image:
            return images.rgb_picture(encode_srgb(curve(linear(frame))))

        return Panel("light", "light", caption, picture, Markup(f", {caption}"))

    def readings(self, sensor: ImageSensor, level: LightLevel) -> Panel:
        """Return the readings of a sensor. Raises UserError if they cannot be treated as asked."""
        name = exposure_name(sensor, level)
        counts, full = (self.sequence.counts(name, array) for array in ("counts", "saturated"))
        unit = counts.unit.split()[0]
        raw = ShownReadings(counts.shape, lambda part: (counts[part], full[part]), unit, sensor)
        panel = readings_panel(raw.treated(self._treatment), self.frames, self.step)
        return replace(panel, sensor=sensor.name, level=self._level(level))

    def found_flow(self, sensor: ImageSensor, level: LightLevel) -> Panel | None:
        """Return the flow by the best method on an exposure; None if no velocity method ran."""
        able = [
            record
            for record in self.records
            if (record.sensor, record.level) == (sensor.name, level)
            and METHODS[record.method].gives == "velocity"
        ]
        if not able or self.rim is None:
            return None
        method = min(able, key=lambda record: record.median_error).method
        path = responses_path(self.sequence.dataset, sensor, level)
        with bounded.undamaged(path, "run flow again"):
            stored = StoredFrames.open(path, method)
        grid = velocity_method(method).grid(self.sequence.shape)
        inside = np.ones((grid.block_px, grid.block_px, 1))

        def flow(frame: int) -> Floats:
            blocks = stored.read([min(frame, len(stored) - 1)])[0].astype(np.float64)
            covered = np.kron(blocks, inside)
            pixels = np.full((*grid.shape, 2), np.nan)
            rows, columns = covered.shape[:2]
            pixels[grid.top : grid.top + rows, grid.left : grid.left + columns] = covered
            return self.pixels(pixels)

        panel = flow_panel("flow", f"flow by {method}", flow, self.rim)
        return replace(panel, sensor=sensor.name, level=self._level(level))

    def dense_flow(self, record: FlowRecord) -> Panel:
        """Return the flow of every pixel, measured again, by the method of a record."""
        detector = velocity_method(record.method)
        counts = self.sequence.counts(f"{record.sensor}-{level_text(record.level)}")

        def flow(frame: int) -> Floats:
            last = min(frame + 1, len(self.sequence) - 1)
            return self.pixels(detector.dense(counts[last - 1], counts[last]))

        is_dense = type(detector).dense is not BlockDetector.dense  # others give blocks
        name = f"flow by {record.method}{', pixel by pixel' if is_dense else ''}"
        panel = flow_panel("flow", name, flow, self.rim or 1.0)
        return replace(panel, sensor=record.sensor, level=self._level(record.level))

    def motion(self, name: str) -> Panel:
        """Return the motion to the next frame; of pictures, the flow of the clean ones."""
        return flow_panel("motion", name, self.motion_of, self.rim or 1.0)

    @property
    def depth(self) -> Panel:
        """Depth in logarithmic colors, the sky gray."""

        def log_depth(frame: int) -> Floats:
            depth = self.pixels(self.sequence.depth[frame]).astype(np.float64)
            return np.log(np.where(np.isinf(depth), np.nan, depth))

        sampled = np.concatenate([log_depth(frame).ravel() for frame in self._sampled])
        known = sampled[~np.isnan(sampled)]
        ends = np.percentile(known, [1, 99]).tolist() if known.size else (0.0, math.log(2))
        near, far = ends[0], max(ends[1], ends[0] + 0.01)
        scale = images.map_scale("viridis_r", near, far)
        low, high = number(math.exp(near)), f"{number(math.exp(far))} m"
        caption = f"yellow {low} m to violet {high}, the sky gray"
        legend = scale.legend(low, high, "sky" * (known.size < sampled.size))
        return Panel("depth", "depth", caption, lambda at: scale.picture(log_depth(at)), legend)

    def pixels(self, image: NDArray[Any]) -> NDArray[Any]:
        """Return the shown pixels of an image (H, W, ...)."""
        return image[:: self.step, :: self.step]

    def motion_of(self, frame: int) -> NDArray[np.floating]:
        """Return the motion from a frame to the next (h, w, 2), px, NaN where undefined.

        Of pictures, whose true motion is unknown, it is the flow between the noise-free pictures,
        reduced by `step`.
        """
        sequence = self.sequence
        if frame + 1 == len(sequence):
            return np.full((*self.pixels(np.empty(sequence.shape)).shape, 2), np.nan)
        if not sequence.configuration.scene.has_truth:
            frames, (rows, columns) = light_of(sequence.dataset).frames, sequence.shape
            small = -(-rows // self.step), -(-columns // self.step)
            first, second = (resized(frames.at(index), small) for index in (frame, frame + 1))
            return self.step * clean_flow(first, second)
        if sequence.configuration.shutter.readout_s:  # the small files have that of whole frames
            return self.pixels(sequence.flow(frame))
        path = sequence.dataset.frame("training/flow", frame)
        with bounded.undamaged(path, "regenerate the sequence"):
            return self.pixels(formats.read_flo(path))

    def _level(self, level: LightLevel) -> str:
        """Return the name of a level; for pictures, with the photons of the first sensor."""
        settings, name = self.sequence.configuration, level_name(level)
        if not isinstance(settings.scene, Pictures):
            return name
        mean = self.sequence.dataset.read_scene_record()["pictures"]["mean"]
        bands, sensor = settings.render.bands_nm, settings.sensors[0]
        of_unit = light_of(self.sequence.dataset).radiance_of_unit
        per_lux = photons_per_lux(of_unit, settings.light, bands, sensor, mean)
        return f"{name}, {number(per_lux * illuminance_of(level))} photons"


def readings_panel(readings: ShownReadings, frames: Listed[int], step: int) -> Panel:
    """Return readings as grays from none, or of uniform ones their darkest hundredth, to white."""
    sampled = [readings.frame(frame) for frame in images.evenly_spaced(frames, _SAMPLED)]
    shown = np.stack([values for values, _ in sampled])
    is_net = readings.unit == "events" and bool((shown < 0).any())  # of ON and OFF
    black, bright = np.percentile(abs(shown), (1, 95)).tolist()
    white = max(bright, 1e-6 if readings.treatment.is_inverted else 1.0)
    black = black if white > black > white / 2 else 0.0
    scale = images.map_scale("RdBu", -white, white) if is_net else images.gray_scale(white, black)

    @lru_cache(MOST_FRAMES)
    def picture(frame: int) -> Image.Image:
        values, full = readings.frame(frame)
        values = values[::step, ::step]
        if values.ndim == 2:
            return scale.picture(values, full[::step, ::step])
        share = np.clip((values - black) / (white - black), 0, 1) ** (1 / scale.root)
        return images.rgb_picture(np.rint(255 * share).astype(np.uint8))

    is_full = any(full.any() for _, full in sampled)
    unit = "detections" if readings.treatment.is_inverted else readings.unit
    low, high = f"{'≤ ' * (black > 0)}{short(black)}", f"≥ {short(white)} {unit}"
    caption = f"black {short(black)}, white {number(white)} {unit}"
    note = "orange: saturated pixels" if is_full else ""
    if is_net:
        low, high, note = f"≥ {short(white)} OFF", f"≥ {short(white)} ON", "blue: ON, red: OFF"
        caption = f"{note}; full color: {number(white)} events"
    legend = scale.legend(low, high, "saturated" if is_full else "")
    return Panel("readings", unit, caption, picture, legend, note)


def flow_panel(
    kind: Literal["flow", "motion"],
    name: str,
    flow: Callable[[int], NDArray[np.floating]],
    fastest: float,
) -> Panel:
    """Return flow (h, w, 2) of frames as colors; the speed `fastest` has the full one."""
    caption = f"hue is direction (red to the right), full color {number(fastest)} px per frame"

    @lru_cache(MOST_FRAMES)
    def picture(frame: int) -> Image.Image:
        return images.rgb_picture(flow_to_rgb(flow(frame), fastest))

    return Panel(kind, name, caption, picture)


def checked_json(path: Path, check: Callable[[Any], _Read], remedy: str) -> _Read:
    """Return the content of a JSON file once it is checked. Raises UserError if it is damaged."""
    with bounded.undamaged(path, remedy):
        return check(bounded.read_json(path))
