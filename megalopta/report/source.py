"""Data of the report: every finished stage, read once, when it is first asked for."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from megalopta.core.progress import say
from megalopta.dataset.flow_record import FlowRecord
from megalopta.dataset.store import Dataset
from megalopta.flow.benchmark.sequence import BenchmarkResult
from megalopta.report.budget import ExposureSummary, exposed
from megalopta.report.footage import ReportFrames, Selection, read_footage
from megalopta.report.images import data_uri, film_strip, rgb_picture
from megalopta.report.records import Record, read_benchmark, read_records, read_scene_record
from megalopta.stages.ledger import Ledger
from megalopta.stages.registry import STAGES

_PLAYBACK_HZ = (2.0, 25.0)
"""Faster than this, or slower, a film cannot be followed."""
_FASTEST_PERCENT = 99.0
_SMALLEST_SPEED = 1e-3
_RED_END_NM = 700.0


@dataclass(frozen=True)
class PageFilm:
    """The films of a page, which follow one slider."""

    frames: tuple[int, ...]
    """Their numbers in the sequence"""
    start: int
    """Place of the frame that is shown first"""
    playback_hz: float
    frame_rate_hz: float
    aspect: str
    radiance: str
    """Data URI of the tone-mapped radiance, which is on the page once"""
    note: str


class Report:
    """A dataset as the report sees it; everything is read once, when it is first asked for.

    Raises UserError, at once where numbers of a finished stage are damaged, else when a file that
    is asked for cannot be read.
    """

    def __init__(self, dataset: Dataset) -> None:
        self.dataset, self.settings = dataset, dataset.configuration
        self.units = sorted({sensor.unit for sensor in self.settings.sensors})
        ledger = Ledger(dataset)
        ledger.require("render")
        self.scene: Record = read_scene_record(dataset)
        self.finished = ledger.finished()
        timings = ledger.timings()
        self.timings = {stage: timings[stage] for stage in STAGES if stage in timings}
        for stage in STAGES:
            if stage not in self.finished and ledger.has(stage):
                say(f"report: stage {stage!r} is not finished with this configuration")
        # before pictures are drawn for seconds
        self.flow: list[FlowRecord] = read_records(dataset) if "flow" in self.finished else []
        self.benchmarks: list[BenchmarkResult] = []
        """As configured, and by the other normalization where that was measured too"""
        if "benchmark" in self.finished:
            both = self.settings.benchmark.both_normalizations
            names = ("benchmark.json", *(["benchmark-other.json"] if both else []))
            self.benchmarks = [read_benchmark(dataset, name) for name in names]

    @cached_property
    def footage(self) -> ReportFrames:
        """The frames that are shown."""
        return read_footage(self.dataset)

    @property
    def selection(self) -> Selection:
        """Their numbers and pixels."""
        return self.footage.selection

    @cached_property
    def exposures(self) -> list[ExposureSummary]:
        """Budget and pictures of every sensor at every level; none where nothing was exposed."""
        if "sense" not in self.finished:
            return []
        return exposed(self.dataset, self.footage, self.scene)

    @cached_property
    def speed(self) -> NDArray[np.floating]:
        """True speed (px per frame) of all pixels in them where it is defined."""
        flow = np.stack([truth.flow_forward for truth in self.footage.truths])
        speed = np.linalg.norm(flow, axis=-1)
        return np.asarray(speed[np.isfinite(speed)])

    @property
    def median_speed(self) -> float:
        """Its median; 0 where nothing is known to move."""
        return float(np.median(self.speed)) if self.speed.size else 0.0

    @cached_property
    def fastest(self) -> float:
        """Speed that has the full color of the rim of the wheel, two digits."""
        fastest = np.percentile(self.speed, _FASTEST_PERCENT) if self.speed.size else 0.0
        return float(f"{max(float(fastest), _SMALLEST_SPEED):.1e}")

    @property
    def objects_seen(self) -> int:
        """Number of objects in the frames shown."""
        return len(set(np.unique([truth.object_id for truth in self.footage.truths])) - {0})

    @property
    def frame(self) -> int:
        """Frame of the stills: shown, in the second half, and with responses that have settled."""
        warm_up = max((record.warm_up_frames for record in self.flow), default=0)
        wanted = max(self.settings.trajectory.frames // 2, warm_up)
        frames = self.selection.frames
        return next((frame for frame in frames if frame >= wanted), frames[-1])

    def film(self) -> PageFilm:
        """Return how films are shown."""
        trajectory, camera = self.settings.trajectory, self.settings.camera
        frames, step = self.selection.frames, self.selection.step
        slowest, fastest = _PLAYBACK_HZ
        shown_hz = trajectory.frame_rate_hz * len(frames) / trajectory.frames
        previews = [rgb_picture(each[::step, ::step]) for each in self.footage.previews]
        note = "The rendered light as a well-lit eye would see it."
        if min(self.settings.render.bands_nm)[0] >= _RED_END_NM:
            note = "The rendered light, the mean of its bands in gray: no eye sees it."
        return PageFilm(
            frames=frames,
            start=frames.index(self.frame),
            playback_hz=min(max(shown_hz, slowest), fastest),
            frame_rate_hz=trajectory.frame_rate_hz,
            aspect=f"{camera.width}/{camera.height}",
            radiance=data_uri(film_strip(previews)),
            note=note,
        )
