"""Section "Photons that motion needs": error curves and N_2b of the photon benchmark."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from megalopta.flow.benchmark.sequence import BenchmarkResult
from megalopta.flow.metrics.curve import ErrorCurve
from megalopta.flow.metrics.photon_threshold import Threshold
from megalopta.plotting.text import UNDEFINED, enumerate_words, short
from megalopta.report.budget import Budget
from megalopta.report.charts import MethodThresholds, error_chart, threshold_chart
from megalopta.report.components import Table, crossed
from megalopta.report.verdicts import ACCURATE

Shape = tuple[int, int]

_NORMALIZED = {"per_frame": "every frame", "per_sequence": "the mean frame"}


@dataclass(frozen=True)
class ThresholdSection:
    """Charts and thresholds of the photon benchmark, and how they were measured."""

    curves: Mapping[str, Markup]
    """By title, one per frame size and metric"""
    charts: Mapping[str, Markup]
    """By title, one per frame size"""
    table: Table
    repeats: int
    warm_up: int
    confidence_percent: float
    dark_counts: str
    """Per frame and pixel at each frame size"""
    normalization: str
    """What is brought to the flux, in words"""
    normalizations: Table | None
    """By the other normalization, where that was measured too"""


def threshold_section(
    benchmark: BenchmarkResult, budgets: Sequence[Budget], other: BenchmarkResult | None = None
) -> ThresholdSection:
    """Section of a finished benchmark, beside what the sensors detect.

    `other` is the same benchmark by the other normalization.
    """
    settings = benchmark.settings
    at_shape: dict[Shape, list[ErrorCurve]] = {}
    for curve in benchmark.curves:
        at_shape.setdefault(curve.shape, []).append(curve)
    return ThresholdSection(
        curves=dict(
            _curve_chart([curve for curve in curves if curve.metric == metric], shape, metric)
            for shape, curves in at_shape.items()
            for metric in settings.metrics
        ),
        charts=dict(
            _threshold_chart(curves, shape, budgets)
            for shape, curves in at_shape.items()
            if 2 in settings.bits
        ),
        table=crossed("N_2b in photons per frame", "Detector", _thresholds(benchmark)),
        repeats=settings.repeats,
        warm_up=benchmark.warm_up,
        confidence_percent=100 * settings.confidence,
        dark_counts=_dark_counts(settings.dark_counts, benchmark.frames[1:], at_shape),
        normalization=_NORMALIZED[settings.normalization],
        normalizations=_beside(benchmark, other) if other else None,
    )


def _beside(benchmark: BenchmarkResult, other: BenchmarkResult) -> Table:
    """N_2b by both normalizations, literal error."""
    cells = {}
    for result in (benchmark, other):
        for curve in result.curves:
            if curve.metric == "literal":
                column = f"{_size(curve.shape)}, {_NORMALIZED[result.settings.normalization]}"
                cells[curve.method, column] = str(curve.thresholds.get(2, UNDEFINED))
    return crossed("N_2b by what is brought to the number of photons", "Detector", cells)


def _size(shape: Shape) -> str:
    return f"{shape[1]} × {shape[0]}"


def _dark_counts(
    per_original_pixel: float, original: Sequence[int], shapes: Iterable[Shape]
) -> str:
    """Dark counts of a pixel at each size: a setting per original pixel, times the area ratio."""
    pixels = math.prod(original)
    words = [
        f"{short(per_original_pixel * pixels / math.prod(shape))} at {_size(shape)} px"
        for shape in shapes
    ]
    return enumerate_words(words)


def _curve_chart(curves: Sequence[ErrorCurve], shape: Shape, metric: str) -> tuple[str, Markup]:
    title = f"{_size(shape)} pixels, {metric} error"
    name = f"curve-{shape[0]}-{metric}"
    text = f"Error over photons per frame at {title}, one curve per detector"
    return title, error_chart(curves, name, ACCURATE, text)


def _threshold_chart(
    curves: Sequence[ErrorCurve], shape: Shape, budgets: Sequence[Budget]
) -> tuple[str, Markup]:
    thresholds: dict[str, dict[str, Threshold]] = {}
    for curve in curves:
        if threshold := curve.thresholds.get(2):
            thresholds.setdefault(curve.method, {})[curve.metric] = threshold
    methods = [MethodThresholds(method, each) for method, each in thresholds.items()]
    title = f"{_size(shape)} pixels"
    text = f"Photons per frame that each detector needs at {title}, and what the sensors detect"
    return title, threshold_chart(methods, budgets, f"thresholds-{shape[0]}", text)


def _thresholds(benchmark: BenchmarkResult) -> dict[tuple[str, str], str]:
    return {
        (curve.method, f"{_size(curve.shape)}, {curve.metric}"): str(
            curve.thresholds.get(2, UNDEFINED)
        )
        for curve in benchmark.curves
    }
