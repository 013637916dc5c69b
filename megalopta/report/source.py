"""Data of the report: every finished stage, read once, on first use.

JSON files are validated before use. To keep the file small, few frames and pixels of a sequence are
shown: frames are evenly spaced, pixels are subsampled, not averaged, so that noise looks as strong
as it is. The last frame is omitted: it has no next frame and so no true flow.

The photon budget lists the light on a pixel in one exposure and the sensor's response to it.
Readings are counts, or electrons of an integrating sensor. Photons, detections and the
signal-to-noise ratio are those of the frames shown; mean readings and saturation are those of all
stored frames.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from megalopta.config.light_scale import light_scale
from megalopta.config.model import Configuration, LightLevel
from megalopta.core.errors import refused_as, shell_command
from megalopta.dataset.frames import FrameMotion, read_motion, read_radiance_frame, read_truth_frame
from megalopta.dataset.sequence import Sequence
from megalopta.dataset.store import Dataset
from megalopta.flow.benchmark import BenchmarkResult
from megalopta.flow.detectors.registry import METHODS
from megalopta.plotting.sections import paragraph
from megalopta.plotting.style import GLYPHS, method_style
from megalopta.plotting.svg import themed
from megalopta.plotting.text import number, percent
from megalopta.report.images import (
    PLAYBACK_HZ,
    Selection,
    data_uri,
    film_strip,
    frame_label,
    selection,
)
from megalopta.report.seen_sequence import ShownSequence, checked_json
from megalopta.scenes.levels import illuminance_of
from megalopta.sensor import ImageSensor, OpenedCounts, detected_photons, expectation
from megalopta.stages.noise_warning import variances
from megalopta.stages.registry import STAGES
from megalopta.stages.run import require, timings
from megalopta.stages.sense import open_exposure, require_expectation

if TYPE_CHECKING:
    from megalopta.render import Truth

Record = Mapping[str, Any]


_LONGEST_SIDE_PX = 160
_MOST_FRAMES = 40
_MOST_PIXELS_READ = 4_000_000
_OTHER_FILMS = 6


def select(configuration: Configuration) -> Selection:
    """Choose the frames and pixels of a sequence to show."""
    height, width = configuration.camera.height, configuration.camera.width
    films = len(configuration.sensors) * len(configuration.light_levels) + _OTHER_FILMS
    most = min(_MOST_FRAMES, _MOST_PIXELS_READ // (height * width))
    candidates = range(max(configuration.trajectory.frames - 1, 1))
    return selection(candidates, (height, width), films, _LONGEST_SIDE_PX, most)


# Percentiles of pixels, drawn as the band of the signal-to-noise ratio.
_SPREAD_PERCENT = (5, 50, 95)
_BRIGHTER = 0.01


@dataclass(frozen=True, eq=False)
class Budget:
    """One sensor at one light level; means over pixels and frames unless stated."""

    sensor: ImageSensor
    level: LightLevel
    illuminance_lux: float
    photons: float
    """Photons on a pixel per exposure"""
    detected: float
    """Detected photons, without dead time"""
    dark: float
    """Reading of a pixel in the dark"""
    expected: float
    """Mean reading, including dark readings"""
    signal_to_noise: tuple[float, float, float]
    """Percentiles 5, 50 and 95 of single pixels of the middle frame"""
    saturated_fraction: float
    """Share of saturated readings"""
    photons_per_frame: float
    """Detected photons summed over the frame"""
    rendering_noise: float = math.nan
    """Rendering noise of a pixel over its shot noise (standard deviations); NaN if not measured"""


def by_sensor(budgets: Iterable[Budget]) -> dict[str, list[Budget]]:
    """Budgets by sensor name, in order."""
    found: dict[str, list[Budget]] = {}
    for each in budgets:
        found.setdefault(each.sensor.name, []).append(each)
    return found


def exposed(report: "Report", sensor: ImageSensor, level: LightLevel) -> Budget:
    """Return the budget of a sensor at a level."""
    opened, settings = open_exposure(report.dataset, sensor, level), report.settings
    scale, noise = light_scale(settings, level), report.scene.get("monte_carlo") or {}
    light = report.radiance * scale.astype(np.float32)
    frames = list(report.shown.frames)
    with refused_as(f"sensor {opened.sensor.name!r}"):  # a measured map is missing
        budget = _budget(settings, light, opened, frames, level)
    if "covariance" not in noise:
        return budget
    rendering, shot, _ = variances(noise, settings, opened.sensor, scale)
    relative = math.sqrt(max(rendering, 0.0) / shot) if shot else math.inf
    return replace(budget, rendering_noise=relative)


def _budget(
    settings: Configuration,
    light: NDArray[np.float32],
    opened: OpenedCounts,
    frames: list[int],
    level: LightLevel,
) -> Budget:
    sensor, bands = opened.sensor, settings.render.bands_nm
    detected = detected_photons(light, bands, sensor)
    middle = len(frames) // 2
    at: dict[str, Any] = {
        "first_frame": frames[middle],
        "frame_period_s": 1 / settings.trajectory.frame_rate_hz,
    }
    dark, seen, brighter = (
        expectation(np.float32(factor) * light[[middle]], bands, sensor, **at)
        for factor in (0.0, 1.0, 1 + _BRIGHTER)
    )
    ratio = seen.signal_to_noise(brighter, _BRIGHTER)
    low, median, high = np.percentile(ratio, _SPREAD_PERCENT)
    return Budget(
        sensor=sensor,
        level=level,
        illuminance_lux=illuminance_of(level),
        photons=float(opened["photons"][frames].mean()),
        detected=float(detected.mean()),
        dark=float(dark.mean_reading.mean()),
        expected=opened["mean_reading"].mean(),
        signal_to_noise=(float(low), float(median), float(high)),
        saturated_fraction=opened["saturated"].mean(),
        photons_per_frame=float(detected.sum(axis=(1, 2)).mean()),
    )


_RED_END_NM = 700.0
_CAUTION = 0.1


class ReportedSequence(ShownSequence):
    """Panels of the report: readings as bright as the light, the motion that errors refer to."""

    white_percentile = 90.0
    """As in the preview of the radiance: the brightest tenth may be pure white."""

    @cached_property
    def motions(self) -> dict[int, FrameMotion]:
        """Motion of each frame to the next; for pictures, a stand-in for the true one.

        A single frame has none.
        """
        if len(self.sequence) < 2:
            return {}
        return {frame: read_motion(self.sequence.dataset, frame) for frame in self.frames}

    def motion_of(self, frame: int) -> NDArray[np.floating]:
        """Return the motion of a frame shown (h, w, 2), px, NaN where undefined."""
        return self.pixels(self.motions[frame].flow)


class Report:
    """A dataset as seen by the report; everything is read once, on first use.

    Raises UserError for damaged numbers of a finished stage at once, for an unreadable file on use.
    """

    def __init__(self, dataset: Dataset) -> None:
        self.dataset, self.settings = dataset, dataset.configuration
        self.units = sorted({sensor.unit for sensor in self.settings.sensors})
        require(dataset, "render")
        again = f"run: {shell_command('render', dataset.root, '--out', dataset.root, '--redo')}"
        self.scene: Record = checked_json(dataset.scene_record, dict, again)
        self.finished = self.shown.finished
        spent = timings(dataset)
        self.timings = {stage: spent[stage] for stage in STAGES if stage in spent}
        # before pictures take seconds to draw
        self.flow = self.shown.records
        self.benchmarks: list[BenchmarkResult] = []
        if "benchmark" in self.finished:
            again = f"run: {shell_command('benchmark', 'photons', dataset.root, '--redo')}"
            path = dataset.result("benchmark.json")
            self.benchmarks = [checked_json(path, BenchmarkResult.from_dict, again)]

    @cached_property
    def shown(self) -> ReportedSequence:
        """Frames and pixels shown, as sensors see them."""
        return ReportedSequence(Sequence(self.dataset), *select(self.settings))

    @cached_property
    def radiance(self) -> NDArray[np.float32]:
        """Light of the frames shown (n, H, W, B)."""
        frames = self.shown.frames
        return np.stack([read_radiance_frame(self.dataset, index) for index in frames])

    @cached_property
    def truths(self) -> "list[Truth]":
        """Ground truth of the frames shown."""
        return [read_truth_frame(self.dataset, index) for index in self.shown.frames]

    @property
    def has_truth(self) -> bool:
        """True if frames were rendered, so that their true motion is known."""
        return self.settings.scene.has_truth

    @property
    def motion_name(self) -> str:
        """Name of the reference motion."""
        return "true motion" if self.has_truth else "flow of the clean pictures"

    @cached_property
    def exposures(self) -> list[Budget]:
        """Budget of every sensor at every level; empty if nothing was exposed."""
        found = self.settings.exposures if "sense" in self.finished else ()
        if found:
            require_expectation(self.dataset)
        return [exposed(self, *each) for each in found]

    @cached_property
    def speed(self) -> NDArray[np.floating]:
        """Speed (px per frame) of all pixels of the frames shown where it is defined."""
        flow = [motion.flow.reshape(-1, 2) for motion in self.shown.motions.values()]
        speed = np.linalg.norm(np.concatenate([np.zeros((0, 2)), *flow]), axis=-1)
        return np.asarray(speed[np.isfinite(speed)])

    @property
    def median_speed(self) -> float:
        """Median speed; 0 if no motion is known."""
        return float(np.median(self.speed)) if self.speed.size else 0.0

    @property
    def fastest(self) -> float:
        """Speed (px per frame) at the rim of the color wheel, two digits."""
        return self.shown.rim or 0.0

    @property
    def objects_seen(self) -> int:
        """Number of objects in the frames shown."""
        return len(set(np.unique([truth.object_id for truth in self.truths])) - {0})

    @property
    def frame(self) -> int:
        """Frame of the stills: shown, in the second half, and with settled responses."""
        warm_up = max((record.warm_up_frames for record in self.flow), default=0)
        wanted = max(self.settings.trajectory.frames // 2, warm_up)
        frames = self.shown.frames
        return next((frame for frame in frames if frame >= wanted), frames[-1])

    def film(self) -> dict[str, Any]:
        """Return the settings of the page's films, which follow one slider."""
        trajectory, camera = self.settings.trajectory, self.settings.camera
        frames = self.shown.frames
        slowest, fastest = PLAYBACK_HZ
        shown_hz = trajectory.frame_rate_hz * len(frames) / trajectory.frames
        note = "The light in photopic colors."
        if min(self.settings.render.bands_nm)[0] >= _RED_END_NM:
            note = "The light, mean of its bands in gray; it is invisible."
        return {
            "labels": [frame_label(each, trajectory.times_s) for each in frames],
            "start": frames.index(self.frame),
            "playback_hz": min(max(shown_hz, slowest), fastest),
            "choices": (),
            "aspect": f"{camera.width}/{camera.height}",
            "radiance": data_uri(film_strip([self.shown.light.picture(each) for each in frames])),
            "note": note,
        }


def absent(report: Report, stage: str, what: str) -> Markup:
    """Return the command to run for a missing stage."""
    root = report.dataset.root
    return paragraph(
        Markup("{} Run <code>{}</code> and then <code>{}</code>.").format(
            what, shell_command(*stage.split(), root), shell_command("report", root)
        ),
        "absent",
    )


def rendering(record: Record, consequence: str) -> Markup:
    """Return the noise of the rendering, from a scene record; empty if unknown.

    More than a tenth of a pixel's light (median over pixels) is a warning. The render stage
    measures it, on pixels without sky if there are any.
    """
    noise = record.get("monte_carlo")
    if not noise or not noise["median_relative"]:
        return Markup("")
    relative = noise["median_relative"]
    caution = Markup("<b>Caution: noisy rendering.</b> ") if relative > _CAUTION else ""
    photons = number(noise["equivalent_photons_per_pixel"])
    text = Markup(
        "{}The rendering is as noisy as {} photons per pixel ({} of a pixel’s light, median over "
        "pixels). {}"
    )
    kind = "warn" if relative > _CAUTION else "note"
    return paragraph(text.format(caution, photons, percent(relative), consequence), kind)


def rendering_errors(record: Record) -> Iterator[tuple[str, str]]:
    """Yield errors of the rendered light, by name."""
    noise = record.get("monte_carlo") or {}
    if noise.get("median_relative"):
        yield "error (RMS) over the mean light", percent(noise["rms_over_mean"])
    if surface := noise.get("surface"):
        yield "the same, of pixels without sky", percent(surface["rms"])
        yield "relative error of 95 % of the pixels", f"{percent(surface['p95'])} or less"
        yield "share of the gradient energy due to it", percent(surface["gradient"])
        yield "fixed error of baked light (RMS)", percent(surface["standing"])
        share = percent(surface["standing_gradient"])
        yield "share of the gradient energy due to the fixed error", share
    if sky := noise.get("sky"):
        yield "error of the sky (RMS) over its light", percent(sky["rms"])
    if shares := record.get("light_left_out"):
        yield "truncation bias of path depth, worst band", percent(max(shares))


def key(report: Report) -> Markup:
    """Return the markers of all methods in their colors, with their names."""
    line = Markup('<li><span style="color:{}" aria-hidden="true">{}</span> <b>{}</b> {}</li>')
    lines = []
    for name in report.settings.methods:
        style = method_style(name)
        color, glyph = themed(style["color"]), GLYPHS[style["marker"]]
        lines.append(line.format(color, glyph, name, METHODS[name].label))
    return Markup('<ul class="key">{}</ul>').format(Markup("").join(lines))
