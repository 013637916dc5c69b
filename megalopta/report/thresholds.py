"""Section "Photons needed": error curves and N_2b of the photon benchmark."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import cycle
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter
from matplotlib.typing import LineStyleType

from megalopta.flow.benchmark import BenchmarkResult
from megalopta.flow.metrics.photon_threshold import ErrorCurve, Threshold
from megalopta.plotting.sections import Section, block, card, heading, paragraph
from megalopta.plotting.style import BLACK, DASHES, RULE, method_style, write_at
from megalopta.plotting.svg import (
    CHART_PT,
    NUMBERS,
    drawable,
    in_style,
    logarithmic,
    new_axes,
    to_svg,
    verbatim,
)
from megalopta.plotting.text import UNDEFINED, level_name, percent, short
from megalopta.report.detectors import ACCURATE, crossed
from megalopta.report.source import Budget, Report, absent, by_sensor, key, rendering

Shape = tuple[int, int]
Style = dict[str, Any]
Needs = Mapping[str, Mapping[str, Threshold]]
"""Photons per frame that methods need, in each metric"""

_BAND_STANDARD_ERRORS = 2
_SMALLEST_ERROR, _LARGEST_ERROR = 1e-3, 1e3
_ERRORS = FuncFormatter(
    lambda value, _: f"{100 * value:g} %" if value < 9.9 else f"{short(value)}×"
)

_NORMALIZED = {"per_frame": "every frame", "per_sequence": "the mean frame"}
_GUIDE = Markup(
    "How many photons per frame does a detector need to repeat its noise-free response to 2 bits, "
    "within 25 %? Errors against the true motion are not measured here. The sequence is scaled to "
    "each number of photons, drawn {} times and measured; N<sub>2b</sub> is where the error curve "
    "falls below 25 %. These pixels detect every photon and have dark counts in proportion to "
    "their area ({}, per frame)."
)
_FLICKER = Markup(
    "This noise is the same in both responses: N<sub>2b</sub> measures how well a detector repeats "
    "its response to this light, including the rendering’s flicker."
)
_SUPPLY = (
    "Markers: filled for the literal error, open for the ratio; bars are {:g} % CI. Diamonds: "
    "photons that each sensor detects per frame at each light level. A marker left of a light’s "
    "line means enough photons, apart from the sensor’s dark readings."
)
_CURVES = (
    "Bands are ± 2 standard errors; errors of exactly zero and beyond the axis are not drawn. "
    "Frames in which the filters settle are not scored ({} at the start)."
)
_NORMALIZATIONS = (
    "Above, it is {}. The dissertation scales every frame; scaling by the mean frame keeps bright "
    "frames bright, as a camera with a fixed exposure does."
)
_UNITS = Markup(
    "k, M, G, T: 10³, 10⁶, 10⁹, 10¹². Intervals are over draws of photons, not over scenes. The "
    "literal error divides by each single response: where many are near zero, its N<sub>2b</sub> "
    "is far above that of the ratio."
)


def threshold_section(report: Report) -> Section:
    """Return the section; without a benchmark, the command to run."""
    title = "Photons needed"
    section = Section(title, name="photons", link="Photons needed")
    if not report.benchmarks:
        what = "The photon benchmark has not run yet."
        return replace(section, body=absent(report, "benchmark photons", what))
    benchmark = report.benchmarks[0]
    settings = benchmark.settings
    # per pixel at each size: those of the original times the area ratio
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
    """Yield the photons that detectors need, with those that sensors detect."""
    if 2 not in benchmark.settings.bits:
        return
    charts = [
        card(f"N_2b, {_size(shape)} pixels", threshold_chart(_met(curves), report.exposures, shape))
        for shape, curves in _by_shape(benchmark).items()
    ]
    yield block("pair", *charts)
    yield paragraph(_SUPPLY.format(100 * benchmark.settings.confidence), "note")


def _met(curves: Sequence[ErrorCurve]) -> Needs:
    found: dict[str, dict[str, Threshold]] = {}
    for curve in curves:
        if threshold := curve.thresholds.get(2):
            found.setdefault(curve.method, {})[curve.metric] = threshold
    return found


def _curves(report: Report, benchmark: BenchmarkResult) -> Iterator[Markup]:
    """Yield a chart of errors over photons per size and metric."""
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
    """Yield tables of N_2b, and of its literal form with both normalizations."""
    first = benchmarks[0]
    settings = first.settings
    yield heading(f"N_2b in photons per frame, with {100 * settings.confidence:g} % CI")
    yield crossed("N_2b in photons per frame", "Detector", _cells(first.curves))
    if len(benchmarks) > 1:
        beside: dict[tuple[str, str], str] = {}
        for each in benchmarks:
            what = _NORMALIZED[each.settings.normalization]
            literal = [curve for curve in each.curves if curve.metric == "literal"]
            beside |= _cells(literal, what)
        yield heading("Normalization to the number of photons")
        yield paragraph(_NORMALIZATIONS.format(_NORMALIZED[settings.normalization]))
        yield crossed("N_2b by normalization", "Detector", beside)
    yield paragraph(_UNITS, "note")


def _cells(curves: Sequence[ErrorCurve], what: str = "") -> dict[tuple[str, str], str]:
    return {
        (curve.method, f"{_size(curve.shape)}, {what or curve.metric}"): str(
            curve.thresholds.get(2, UNDEFINED)
        )
        for curve in curves
    }


@in_style
def error_chart(curves: Sequence[ErrorCurve], name: str, level: float, description: str) -> Markup:
    """Draw error over photons per frame with intervals, a curve per method; NaN or 0 is a gap."""
    figure, axes = new_axes(CHART_PT[0], 300)
    for curve in curves:
        style = method_style(curve.method)
        spread = _BAND_STANDARD_ERRORS * np.array(curve.standard_errors)
        errors = drawable(np.array(curve.errors))
        lower, upper = (np.clip(errors + sign * spread, 1e-9, None) for sign in (-1, 1))
        axes.fill_between(curve.fluxes, lower, upper, color=style["color"], alpha=0.2, linewidth=0)
        axes.plot(curve.fluxes, errors, **style, markersize=4)
    axes.axhline(level, color=BLACK, linewidth=1.2, linestyle="--")
    right: Style = {"xycoords": ("axes fraction", "data"), "ha": "right", "fontsize": 10.5}
    write_at(axes, f"{percent(level)} error", (1, level), (-3, 3), **right)
    logarithmic(axes, "x", NUMBERS)
    logarithmic(axes, "y", _ERRORS)
    largest = max((float(np.nanmax(each.errors, initial=1)) for each in curves), default=1.0)
    axes.set(
        xlabel="photons per frame",
        ylabel="error of the response",
        ylim=(_SMALLEST_ERROR, min(_LARGEST_ERROR, 2 * max(largest, 1))),
    )
    return to_svg(figure, name, description)


@in_style
def threshold_chart(methods: Needs, budgets: Sequence[Budget], shape: Shape) -> Markup:
    """Draw photons that each method needs, and photons that each sensor detects at each level.

    `shape` is that of the frames that methods see. Filled markers are the first metric, open ones
    the others.
    """
    supplies = by_sensor(budgets)
    first = 1.5 * len(supplies)
    places = [
        *(1.5 * row for row in range(len(supplies))),
        *(first + n for n in range(len(methods))),
    ]
    bottom = places[-1] + 0.7
    figure, axes = new_axes(CHART_PT[0], 50 + 42 * len(supplies) + 28 * len(methods))
    axes.set(xscale="log", xlim=_flux_range(methods, budgets), ylim=(bottom, -0.9))
    for own, place, dash in zip(supplies.values(), places, cycle(DASHES), strict=False):
        _draw_supply(axes, own, place, bottom, dash)
    for name, place in zip(methods, places[len(supplies) :], strict=True):
        _draw_thresholds(axes, name, methods[name], place)
    axes.set_yticks(places, map(verbatim, [*supplies, *methods]))
    axes.tick_params(axis="y", length=0)
    logarithmic(axes, "x", NUMBERS)
    axes.grid(visible=False)
    axes.set_xlabel("photons per frame")
    if supplies:
        axes.axhline(first - 0.65, color=RULE, linewidth=0.8)
    needed = f"Photons per frame that each detector needs at {_size(shape)} pixels"
    return to_svg(figure, f"thresholds-{shape[0]}", f"{needed}, and what the sensors detect")


def _draw_supply(
    axes: Axes, budgets: Sequence[Budget], place: float, bottom: float, dash: LineStyleType
) -> None:
    """Mark the photons at each level, each name above or below, whichever is free."""
    decades = math.log10(axes.get_xlim()[1] / axes.get_xlim()[0])
    line: Style = {"color": BLACK, "alpha": 0.4, "linewidth": 1, "linestyle": dash, "zorder": 0}
    last, above = -math.inf, False
    for budget in sorted(budgets, key=lambda each: each.photons_per_frame):
        flux = budget.photons_per_frame
        if flux <= 0:
            continue
        above = not above or math.log10(flux) - last >= 0.22 * decades
        last = math.log10(flux)
        axes.plot([flux, flux], [place, bottom], **line)
        axes.plot(flux, place, color=BLACK, marker="d", markersize=6)
        offset, side = (6, "bottom") if above else (-6, "top")
        name = verbatim(level_name(budget.level))
        write_at(axes, name, (flux, place), (0, offset), ha="center", va=side, fontsize=10)


def _draw_thresholds(
    axes: Axes, method: str, thresholds: Mapping[str, Threshold], place: float
) -> None:
    style = method_style(method)
    for index, (metric, threshold) in enumerate(thresholds.items()):
        height = place + 0.24 * (index - (len(thresholds) - 1) / 2)
        face = style["color"] if index == 0 else "none"
        if threshold.flux is None:
            _draw_absence(axes, threshold, height, metric)
            continue
        ends = [threshold.low or threshold.range_min, threshold.high or threshold.range_max]
        bar: Style = {"color": style["color"], "linewidth": 2.2, "solid_capstyle": "butt"}
        axes.plot(ends, [height, height], **bar)
        axes.plot(threshold.flux, height, markersize=6, markerfacecolor=face, **style)


def _draw_absence(axes: Axes, threshold: Threshold, height: float, metric: str) -> None:
    beyond = {"above": (threshold.range_max, "right"), "below": (threshold.range_min, "left")}
    flux, side = beyond.get(threshold.kind, (math.sqrt(np.prod(axes.get_xlim())), "center"))
    text = f"{metric}: {threshold}"
    axes.text(flux, height, text, ha=side, va="center", fontsize=10)


def _flux_range(methods: Needs, budgets: Sequence[Budget]) -> tuple[float, float]:
    thresholds = [threshold for each in methods.values() for threshold in each.values()]
    fluxes = [each.photons_per_frame for each in budgets if each.photons_per_frame > 0]
    for each in thresholds:
        ends = {"above": [each.range_max], "below": [each.range_min]}.get(each.kind, [])
        fluxes += [flux for flux in (each.flux, each.low, each.high) if flux] + ends
    fluxes = fluxes or [thresholds[0].range_min, thresholds[0].range_max]
    margin = (max(fluxes) / min(fluxes)) ** 0.06 * 1.5
    return min(fluxes) / margin, max(fluxes) * margin
