"""Section "Photons that motion needs": error curves and N_2b of the photon benchmark."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from markupsafe import Markup

from megalopta.flow.benchmark.sequence import BenchmarkResult
from megalopta.flow.metrics.photon_threshold import ErrorCurve, Threshold
from megalopta.plotting.sections import Section, block, card, heading, paragraph
from megalopta.plotting.text import UNDEFINED, short
from megalopta.report.charts import error_chart, threshold_chart
from megalopta.report.detectors import ACCURATE, crossed
from megalopta.report.remarks import absent, key, rendering
from megalopta.report.source import Budget, Report

Shape = tuple[int, int]

_NORMALIZED = {"per_frame": "every frame", "per_sequence": "the mean frame"}
_GUIDE = Markup(
    "How many photons must a frame hold for a detector to repeat its noise-free answer to 2 bits, "
    "within 25 %? Whether that answer is the true motion is not asked here. The sequence is scaled "
    "to each number of photons, drawn {} times and measured; N<sub>2b</sub> is where the error "
    "curve falls below 25 %. These pixels detect every photon and have dark counts in proportion "
    "to their area ({}, per frame)."
)
_FLICKER = Markup(
    "This noise is the same in both answers: N<sub>2b</sub> says how well a detector repeats its "
    "answer to this light, flicker of the rendering included."
)
_SUPPLY = (
    "Markers: filled for the literal error, open for the ratio; bars are {:g} % intervals. The "
    "diamonds are what each sensor detects per frame at each light level: a marker to the left of "
    "a light’s line has photons enough, if the sensor’s own dark readings let it."
)
_CURVES = (
    "Bands are two standard errors to either side; errors of exactly zero and errors beyond the "
    "axis are not drawn. The first {} frames are not scored, while the filters settle."
)
_NORMALIZATIONS = (
    "Above it is {}. The dissertation scales every frame; scaling by the mean frame leaves bright "
    "frames bright, as a camera with a fixed exposure sees them."
)
_UNITS = Markup(
    "k, M, G, T: thousand to million million. The interval says what another draw of photons might "
    "have given, not what another scene would. The literal error divides by each single answer: "
    "where many are near zero, its N<sub>2b</sub> lies far above that of the ratio."
)


def threshold_section(report: Report) -> Section:
    """Return the section; without a benchmark, what to run."""
    title = "Photons that motion needs"
    section = Section(title, name="photons", link="Photons needed")
    if not report.benchmarks:
        what = "The photon benchmark has not been run yet."
        return replace(section, body=absent(report, "benchmark photons", what))
    benchmark = report.benchmarks[0]
    settings = benchmark.settings
    # of a pixel at each size: those of the original, by the area ratio
    counts = settings.dark_counts * math.prod(benchmark.frames[1:])
    shapes = _by_shape(benchmark)
    dark = (f"{short(counts / math.prod(each))} at {_size(each)} px" for each in shapes)
    body = [
        rendering(report.scene, _FLICKER),
        *_needs(report, benchmark),
        *_curves(report, benchmark),
        *_thresholds(report.benchmarks),
    ]
    text = _GUIDE.format(settings.repeats, ", ".join(dark))
    return replace(section, text=text, body=Markup("\n").join(body))


def _by_shape(benchmark: BenchmarkResult) -> dict[Shape, list[ErrorCurve]]:
    found: dict[Shape, list[ErrorCurve]] = {}
    for curve in benchmark.curves:
        found.setdefault(curve.shape, []).append(curve)
    return found


def _size(shape: Shape) -> str:
    return f"{shape[1]} × {shape[0]}"


def _needs(report: Report, benchmark: BenchmarkResult) -> Iterator[Markup]:
    """Yield the photons that detectors need, beside those that sensors detect."""
    if 2 not in benchmark.settings.bits:
        return
    budgets = [each.budget for each in report.exposures]
    charts = [
        card(f"N_2b, {_size(shape)} pixels", _needs_chart(curves, shape, budgets))
        for shape, curves in _by_shape(benchmark).items()
    ]
    yield block("pair", *charts)
    yield paragraph(_SUPPLY.format(100 * benchmark.settings.confidence), "note")


def _needs_chart(curves: Sequence[ErrorCurve], shape: Shape, budgets: Sequence[Budget]) -> Markup:
    thresholds: dict[str, dict[str, Threshold]] = {}
    for curve in curves:
        if threshold := curve.thresholds.get(2):
            thresholds.setdefault(curve.method, {})[curve.metric] = threshold
    text = (
        f"Photons per frame that each detector needs at {_size(shape)} pixels, and what the "
        "sensors detect"
    )
    return threshold_chart(thresholds, budgets, f"thresholds-{shape[0]}", text)


def _curves(report: Report, benchmark: BenchmarkResult) -> Iterator[Markup]:
    """Yield a chart of errors over photons for each size and metric."""
    yield heading("Error over photons")
    yield key(report)
    charts = []
    for shape, curves in _by_shape(benchmark).items():
        for metric in benchmark.settings.metrics:
            title = f"{_size(shape)} pixels, {metric} error"
            own = [curve for curve in curves if curve.metric == metric]
            text = f"Error over photons per frame at {title}, one curve per detector"
            charts.append(
                card(title, error_chart(own, f"curve-{shape[0]}-{metric}", ACCURATE, text))
            )
    yield block("pair", *charts)
    yield paragraph(_CURVES.format(benchmark.warm_up), "note")


def _thresholds(benchmarks: Sequence[BenchmarkResult]) -> Iterator[Markup]:
    """Yield tables of N_2b, and of its literal form by both normalizations."""
    first = benchmarks[0]
    settings = first.settings
    yield heading(f"N_2b in photons per frame, with {100 * settings.confidence:g} % intervals")
    yield crossed("N_2b in photons per frame", "Detector", _cells(first.curves))
    if len(benchmarks) > 1:
        beside: dict[tuple[str, str], str] = {}
        for each in benchmarks:
            what = _NORMALIZED[each.settings.normalization]
            literal = [curve for curve in each.curves if curve.metric == "literal"]
            beside |= _cells(literal, what)
        yield heading("What is brought to the number of photons")
        yield paragraph(_NORMALIZATIONS.format(_NORMALIZED[settings.normalization]))
        yield crossed("N_2b by what is brought to the number of photons", "Detector", beside)
    yield paragraph(_UNITS, "note")


def _cells(curves: Sequence[ErrorCurve], what: str = "") -> dict[tuple[str, str], str]:
    return {
        (curve.method, f"{_size(curve.shape)}, {what or curve.metric}"): str(
            curve.thresholds.get(2, UNDEFINED)
        )
        for curve in curves
    }
