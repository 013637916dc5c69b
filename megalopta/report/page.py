"""All sections of the report, put into the template."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from megalopta.config.model import Configuration
from megalopta.config.yaml_model import to_yaml
from megalopta.core.files import write_text
from megalopta.core.progress import say
from megalopta.dataset.flow_record import FlowRecord
from megalopta.dataset.store import Dataset
from megalopta.flow.benchmark.sequence import BenchmarkResult
from megalopta.flow.detectors.registry import METHODS
from megalopta.generation import versions
from megalopta.plotting.style import GLYPHS, method_style
from megalopta.plotting.svg import themed
from megalopta.plotting.templates import render_page
from megalopta.plotting.text import duration
from megalopta.report.budget import exposed
from megalopta.report.detectors import DetectorSection, detector_section, first_sentence
from megalopta.report.device_cost import DeviceCost, device_costs
from megalopta.report.footage import ReportFrames, read_footage
from megalopta.report.glossary import glossary
from megalopta.report.images import data_uri, rgb_picture, stacked
from megalopta.report.light import LightSection, light_section
from megalopta.report.motion import MotionSection, motion_section
from megalopta.report.ranking import RankingSection, ranking_section
from megalopta.report.reach import reach_findings
from megalopta.report.records import Record, read_benchmark, read_records, read_scene_record
from megalopta.report.rendering import render_noise
from megalopta.report.summary import (
    dark_findings,
    facts,
    lead,
    light_finding,
    threshold_finding,
    title,
)
from megalopta.report.thresholds import ThresholdSection, threshold_section
from megalopta.report.verdicts import MEANINGS
from megalopta.stages.ledger import Ledger
from megalopta.stages.registry import STAGES

# Faster than this, or slower, a film cannot be followed.
_PLAYBACK_HZ = (2.0, 25.0)
_RED_END_NM = 700.0


@dataclass(frozen=True)
class Sections:
    """What the finished stages have to show, and one sentence for each finding."""

    motion: MotionSection
    light: LightSection | None
    detectors: DetectorSection | None
    costs: tuple[DeviceCost, ...]
    thresholds: ThresholdSection | None
    ranking: RankingSection | None
    findings: tuple[str, ...]


def write_report(dataset: Dataset) -> Path:
    """Write DATASET/report.html from the stages that are finished; returns its path.

    Raises
    ------
    UserError
        When nothing was rendered yet, or a file cannot be read.
    """
    Ledger(dataset).require("render")
    path = dataset.root / "report.html"
    write_text(path, page(dataset))
    return path


def page(dataset: Dataset) -> str:
    """Return the report as HTML."""
    settings, timings = dataset.configuration, Ledger(dataset).timings()
    record, footage = read_scene_record(dataset), read_footage(dataset)
    sections = _sections(dataset, footage, record)
    return render_page(
        "megalopta.report",
        "report.html",
        {"duration": duration, "first_sentence": first_sentence},
        dataset=dataset,
        configuration=settings,
        title=title(settings),
        lead=lead(settings, record),
        facts=facts(settings, record, sections.motion),
        sections=sections,
        radiance_film=_radiance_film(footage),
        frames=footage.selection.frames,
        step=footage.selection.step,
        start=_start(footage, sections.detectors),
        playback_hz=_playback_hz(settings, footage),
        methods=[_legend(name) for name in settings.methods],
        meanings=MEANINGS,
        glossary=glossary({sensor.unit for sensor in settings.sensors}),
        columns=_columns,
        visible=min(settings.render.bands_nm)[0] < _RED_END_NM,
        units=sorted({sensor.unit for sensor in settings.sensors}),
        settings=to_yaml(settings),
        versions=versions.versions(),
        scene_record=record,
        render_noise=render_noise(record),
        timings={stage: timings[stage] for stage in STAGES if stage in timings},
    )


def _sections(dataset: Dataset, footage: ReportFrames, record: Record) -> Sections:
    # first, so that a damaged one is told before pictures are drawn for seconds
    finished = _finished(dataset)
    records, benchmarks = _numbers(dataset, finished)
    motion = motion_section(footage, dataset.configuration.flow.least_purity)
    light, detectors, thresholds = None, None, None
    costs: tuple[DeviceCost, ...] = ()
    findings: list[str | None] = []
    budgets = []
    if "sense" in finished:
        shown = exposed(dataset, footage, record)
        budgets = [each.budget for each in shown]
        light = light_section(dataset.configuration.sensors, footage, shown)
        findings += [light_finding(budgets), *dark_findings(budgets)]
    if records is not None:
        detectors = detector_section(dataset, footage, motion.wheel, records)
        costs = device_costs(dataset, footage.selection, detectors.frame, records)
        findings = [*reach_findings(records), *findings]
    if benchmarks is not None:
        benchmark, other = benchmarks
        thresholds = threshold_section(benchmark, budgets, other)
        findings.append(threshold_finding(benchmark.curves, benchmark.settings.metrics[0]))
    ranking = ranking_section(dataset)
    told = tuple(filter(None, findings))
    return Sections(motion, light, detectors, costs, thresholds, ranking, told)


def _finished(dataset: Dataset) -> list[str]:
    """Stages to report on. Raises UserError where a file of one is damaged."""
    ledger = Ledger(dataset)
    finished = ledger.finished()
    for stage in STAGES:
        if stage not in finished and ledger.has(stage):
            say(f"report: stage {stage!r} is not finished with this configuration, and is left out")
    return finished


def _numbers(
    dataset: Dataset, finished: Sequence[str]
) -> tuple[list[FlowRecord] | None, tuple[BenchmarkResult, BenchmarkResult | None] | None]:
    """What the stages of numbers wrote, if they are finished."""
    records = read_records(dataset) if "flow" in finished else None
    if "benchmark" not in finished:
        return records, None
    both = dataset.configuration.benchmark.both_normalizations
    other = read_benchmark(dataset, "benchmark-other.json") if both else None
    return records, (read_benchmark(dataset), other)


def _radiance_film(footage: ReportFrames) -> str:
    step = footage.selection.step
    return data_uri(stacked([rgb_picture(preview[::step, ::step]) for preview in footage.previews]))


def _start(footage: ReportFrames, detectors: DetectorSection | None) -> int:
    """Index of the frame shown first: that of the detectors, or the middle."""
    frames = footage.selection.frames
    return frames.index(detectors.frame) if detectors else len(frames) // 2


def _playback_hz(settings: Configuration, footage: ReportFrames) -> float:
    trajectory = settings.trajectory
    shown_hz = trajectory.frame_rate_hz * len(footage.selection.frames) / trajectory.frames
    slowest, fastest = _PLAYBACK_HZ
    return min(max(shown_hz, slowest), fastest)


def _legend(method: str) -> dict[str, str]:
    style = method_style(method)
    return {
        "name": method,
        "label": METHODS[method].label,
        "color": themed(style["color"]),
        "marker": GLYPHS[style["marker"]],
    }


def _columns(items: int, most: int) -> int:
    """So many a row that rows are nearly alike, and the last holds no single one."""
    return math.ceil(items / math.ceil(items / most))
