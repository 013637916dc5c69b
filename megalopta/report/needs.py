"""Section "Photons that motion needs": error curves and N_2b of the photon benchmark."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from megalopta.flow.benchmark import BenchmarkResult
from megalopta.flow.metrics import ErrorCurve, Metric, Threshold
from megalopta.report.budget import Budget
from megalopta.report.charts import Need, error_chart, need_chart
from megalopta.report.components import Table, crossed
from megalopta.report.text import UNDEFINED, enumerate_words, short
from megalopta.report.verdicts import ACCURATE

Shape = tuple[int, int]


@dataclass(frozen=True)
class Chart:
    """A chart and what stands above it."""

    title: str
    svg: Markup


@dataclass(frozen=True)
class NeedSection:
    """Charts and thresholds of the photon benchmark, and how they were measured."""

    curves: tuple[Chart, ...]
    """One per frame size and metric"""
    needs: tuple[Chart, ...]
    """One per frame size"""
    table: Table
    repeats: int
    warm_up: int
    confidence_percent: float
    dark_counts: str
    """Per frame and pixel at each frame size"""


def need_section(benchmark: BenchmarkResult, budgets: Sequence[Budget]) -> NeedSection:
    """Section of a finished benchmark, beside what the sensors detect."""
    curves, settings = benchmark.curves, benchmark.settings
    shapes = list(dict.fromkeys(curve.shape for curve in curves))
    return NeedSection(
        curves=tuple(
            _curve_chart(_select(curves, shape, metric), shape, metric)
            for shape in shapes
            for metric in settings.metrics
        ),
        needs=tuple(
            _need_chart(_select(curves, shape), shape, budgets)
            for shape in shapes
            if 2 in settings.bits
        ),
        table=crossed("N_2b in photons per frame", "Detector", _thresholds(benchmark)),
        repeats=settings.repeats,
        warm_up=benchmark.warm_up,
        confidence_percent=100 * settings.confidence,
        dark_counts=_dark_counts(settings.dark_counts, benchmark.frames[1:], shapes),
    )


def _select(
    curves: Sequence[ErrorCurve], shape: Shape, metric: Metric | None = None
) -> list[ErrorCurve]:
    return [curve for curve in curves if curve.shape == shape and metric in (None, curve.metric)]


def _size(shape: Shape) -> str:
    return f"{shape[1]} × {shape[0]}"


def _dark_counts(
    per_original_pixel: float, original: Sequence[int], shapes: Sequence[Shape]
) -> str:
    """Dark counts of a pixel at each size: a setting per original pixel, times the area ratio."""
    pixels = math.prod(original)
    words = [
        f"{short(per_original_pixel * pixels / math.prod(shape))} at {_size(shape)} px"
        for shape in shapes
    ]
    return enumerate_words(words)


def _curve_chart(curves: Sequence[ErrorCurve], shape: Shape, metric: str) -> Chart:
    title = f"{_size(shape)} pixels, {metric} error"
    name = f"curve-{shape[0]}-{metric}"
    text = f"Error over photons per frame at {title}, one curve per detector"
    return Chart(title, error_chart(curves, name, ACCURATE, text))


def _need_chart(curves: Sequence[ErrorCurve], shape: Shape, budgets: Sequence[Budget]) -> Chart:
    thresholds: dict[str, dict[str, Threshold]] = {}
    for curve in curves:
        if threshold := curve.thresholds.get(2):
            thresholds.setdefault(curve.method, {})[curve.metric] = threshold
    needs = [Need(method, each) for method, each in thresholds.items()]
    title = f"{_size(shape)} pixels"
    text = f"Photons per frame that each detector needs at {title}, and what the sensors detect"
    return Chart(title, need_chart(needs, budgets, f"need-{shape[0]}", text))


def _thresholds(benchmark: BenchmarkResult) -> dict[tuple[str, str], str]:
    return {
        (curve.method, f"{_size(curve.shape)}, {curve.metric}"): str(
            curve.thresholds.get(2, UNDEFINED)
        )
        for curve in benchmark.curves
    }
