"""Data of the report: every finished stage, read once, on first use."""

import math
from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.config.model import Configuration, LightLevel
from megalopta.core.errors import refused_as, shell_command
from megalopta.dataset.frames import read_radiance_frame, read_truth_frame
from megalopta.dataset.sequence import Sequence
from megalopta.dataset.store import Dataset
from megalopta.flow.benchmark import BenchmarkResult
from megalopta.report import images, sections
from megalopta.report.panels import SequencePanels, checked_json
from megalopta.scenes.levels import illuminance_of
from megalopta.sensor import ImageSensor, detected_photons, expectation
from megalopta.stages.noise_warning import variances
from megalopta.stages.registry import STAGES
from megalopta.stages.run import require, timings
from megalopta.stages.sense import open_exposure, require_expectation

if TYPE_CHECKING:
    from megalopta.render import Truth

_BRIGHTER = 0.01


def select(configuration: Configuration) -> tuple[tuple[int, ...], int]:
    """Choose the frames, and the step between pixels, of a sequence to show."""
    height, width = configuration.camera.height, configuration.camera.width
    films = 3 * (len(configuration.sensors) * len(configuration.light_levels) + 6)  # 4 MB in all
    most = min(40, 4_000_000 // (height * width))
    candidates = range(max(configuration.trajectory.frames - 1, 1))
    return images.selection(candidates, (height, width), films, 160, most)


class Budget(NamedTuple):
    """Light on a pixel in one exposure, and the sensor's response; means over pixels and frames.

    Readings and saturation are those of all stored frames, the others those of the frames shown.
    """

    sensor: ImageSensor
    level: LightLevel
    photons: float
    detected: float
    """Detected photons, without dead time"""
    dark: float
    """Reading of a pixel in the dark"""
    expected: float
    """Mean reading, including dark readings"""
    signal_to_noise: float
    """Median over single pixels of the middle frame"""
    saturated_fraction: float
    photons_per_frame: float
    """Detected photons summed over the frame"""
    rendering_noise: float
    """Rendering noise of a pixel over its shot noise (standard deviations); NaN if not measured"""


class Report:
    """A dataset as seen by the report.

    Raises UserError for damaged numbers of a finished stage at once, for an unreadable file on use.
    """

    def __init__(self, dataset: Dataset) -> None:
        self.dataset, self.settings = dataset, dataset.configuration
        self.units = sorted({sensor.unit for sensor in self.settings.sensors})
        root = dataset.root
        require(dataset, "render")
        remedy = f"run: {shell_command('render', root, '--out', root, '--redo')}"
        self.scene: Mapping[str, Any] = checked_json(dataset.scene_record, dict, remedy)
        spent = timings(dataset)
        self.timings = {stage: spent[stage] for stage in STAGES if stage in spent}
        self.shown = SequencePanels(Sequence(dataset), *select(self.settings))
        # before pictures take seconds to draw
        self.flow = self.shown.records
        self.benchmark: BenchmarkResult | None = None
        if "benchmark" in self.shown.finished:
            remedy = f"run: {shell_command('benchmark', 'photons', root, '--redo')}"
            path = dataset.result("benchmark.json")
            self.benchmark = checked_json(path, BenchmarkResult.from_dict, remedy)

    @cached_property
    def truths(self) -> "list[Truth]":
        """Ground truth of the frames shown; none of pictures."""
        frames = self.shown.frames if self.has_truth else ()
        return [read_truth_frame(self.dataset, frame) for frame in frames]

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
        if "sense" not in self.shown.finished:
            return []
        require_expectation(self.dataset)
        frames = self.shown.frames
        light = np.stack([read_radiance_frame(self.dataset, frame) for frame in frames])
        return [self._budget(light, *exposure) for exposure in self.settings.exposures]

    def _budget(
        self, radiance: NDArray[np.float32], sensor: ImageSensor, level: LightLevel
    ) -> Budget:
        opened, settings = open_exposure(self.dataset, sensor, level), self.settings
        frames, bands = list(self.shown.frames), settings.render.bands_nm
        scale, noise = settings.light_scale(level), self.scene.get("monte_carlo") or {}
        light, middle = radiance * scale.astype(np.float32), len(frames) // 2
        when: dict[str, Any] = {
            "first_frame": frames[middle],
            "frame_period_s": 1 / settings.trajectory.frame_rate_hz,
        }
        with refused_as(f"sensor {opened.sensor.name!r}"):  # a measured map is missing
            detected = detected_photons(light, bands, opened.sensor)
            dark, lit, brighter = (
                expectation(np.float32(factor) * light[[middle]], bands, opened.sensor, **when)
                for factor in (0.0, 1.0, 1 + _BRIGHTER)
            )
        relative_noise = math.nan
        if "covariance" in noise:
            rendering, shot, _ = variances(noise, settings, opened.sensor, scale)
            relative_noise = math.sqrt(max(rendering, 0.0) / shot) if shot else math.inf
        return Budget(
            sensor=opened.sensor, level=level, photons=float(opened["photons"][frames].mean()),
            detected=float(detected.mean()), dark=float(dark.mean_reading.mean()),
            expected=opened["mean_reading"].mean(),
            signal_to_noise=float(np.median(lit.signal_to_noise(brighter, _BRIGHTER))),
            saturated_fraction=opened["saturated"].mean(),
            photons_per_frame=float(detected.sum(axis=(1, 2)).mean()),
            rendering_noise=relative_noise,
        )  # fmt: skip

    def of(self, sensor: str) -> list[Budget]:
        """Return the budgets of a sensor, from the brightest light on."""
        budgets = [budget for budget in self.exposures if budget.sensor.name == sensor]
        return sorted(budgets, key=lambda budget: -illuminance_of(budget.level))

    def player(self) -> sections.Player:
        """Return the slider of the page's films."""
        trajectory, frames = self.settings.trajectory, self.shown.frames
        return sections.Player(
            [images.frame_label(frame, trajectory.times_s) for frame in frames],
            self.shown.sequence.shape,
            trajectory.frame_rate_hz * len(frames) / trajectory.frames,
        )
