"""Sections on motion detectors: their responses and errors, and the photons that they need.

A method with velocities is also compared with the true motion: a consistently wrong one is
perfectly repeatable. The others give a number without a unit, so the only test is whether their
response to counts equals that to the noise-free readings.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from markupsafe import Markup
from matplotlib.ticker import FuncFormatter
from PIL import Image

from megalopta.config.model import LightLevel
from megalopta.core.bounded import undamaged
from megalopta.core.errors import shell_command
from megalopta.dataset.flow_record import FlowRecord, TruthErrors
from megalopta.flow.benchmark import BenchmarkResult
from megalopta.flow.color_wheel import flow_to_rgb
from megalopta.flow.detectors.base import Detector
from megalopta.flow.detectors.registry import METHODS
from megalopta.flow.metrics.photon_threshold import ErrorCurve
from megalopta.report import images, sections as html, style as svg
from megalopta.report.sections import Section
from megalopta.report.source import Budget, Report
from megalopta.report.style import BLACK, method_style
from megalopta.report.text import (
    FAILS,
    SENSELESS,
    UNDEFINED,
    level_name,
    number,
    percent,
    relative_error,
    short,
)
from megalopta.sensor import ImageSensor, StoredFrames
from megalopta.stages.flow import responses_path

Value = TypeVar("Value")

ACCURATE = 0.25
"""The dissertation's 2-bit accuracy: an error below 2⁻²."""
_CAUTION = 0.1
_BRIGHT_PERCENTILE = 99.0
_ROOT = 3.0
"""Responses to bright sky and dark ground differ a thousandfold: a root shows both."""
_PALE = 0.02
"""Share of the rim below which velocities look white"""
_BAND_STANDARD_ERRORS = 2
_SMALLEST_ERROR, _LARGEST_ERROR = 1e-3, 1e3

_GUIDE = (
    "Each detector runs on the readings, and on their noise-free mean. Frame {} is shown in pairs "
    "at each light level, in the same colors: the response to the noise-free reading, and that to "
    "its {}. Where the two look alike, photon noise does no harm."
)
_FLICKER = (
    "This noise is the same in both responses, so it adds no error between them, but it adds to "
    "the errors against the true motion."
)
_ERRORS = Markup(
    "Readings are scaled to a mean of 1; colors show the cube root of the response. Errors compare "
    "the response to counts with that to the noise-free reading, over all frames after the "
    "detectors have settled. <b>Ratio</b>: sum of all differences over sum of all responses. "
    "<b>Literal</b> (the dissertation's Eq. 4.5): mean of each pixel's quotient, dominated by the "
    "few responses near zero. <b>To a perfect sensor</b>: ratio error against the response to the "
    "mean of a perfect sensor, and that of corrected readings if there are any. “fails”: an error "
    "of ten times or more. A dash: the noise-free response shows no motion."
)
_TRUTH = (
    "Mean endpoint error of blocks, share of outliers (blocks with an error over 25 %), and median "
    "relative error: noise-free → on {} → on corrected readings if there are any. {} of the pixels "
    "shown are mixed: the object at their center fills less than {}. {} except in the two tables "
    "that say otherwise."
)
_STAND_IN = (
    "The true motion of pictures is unknown. The flow by DIS between the pictures without photon "
    "noise stands in for it, which favors DIS. "
)
_MIXED = {
    "score": "They count like all others",
    "weigh": "Pixels are weighted by purity",
    "leave_out": "They are excluded",
}
_NEEDED = Markup(
    "How many photons per frame does a detector need to repeat its noise-free response within "
    "25 %, or 2 bits? The sequence is scaled to each number of photons and drawn {} times; "
    "N<sub>2b</sub> is where the error curve falls below 25 %. These pixels detect every photon "
    "and have dark counts in proportion to their area ({}, per frame)."
)
_CURVES = (
    "Bands are ± 2 standard errors; errors of zero and beyond the axis are not drawn. The first {} "
    "frames, in which filters settle, are not scored. Dotted lines: photons that a sensor detects "
    "per frame at a light level. A curve that falls below 25 % on their left needs fewer photons, "
    "apart from the sensor’s dark readings."
)
_NORMALIZED = {"per_frame": "every frame", "per_sequence": "the mean frame"}
_UNITS = Markup(
    "k, M, G, T: 10³, 10⁶, 10⁹, 10¹². Intervals are over draws of photons, not over scenes. The "
    "literal error divides by each single response: where many are near zero, its N<sub>2b</sub> "
    "is far above that of the ratio."
)


def absent(report: Report, stage: str, what: str) -> Markup:
    """Return the command to run for a missing stage."""
    root = report.dataset.root
    return html.paragraph(
        Markup("{} Run <code>{}</code> and then <code>{}</code>.").format(
            what, shell_command(*stage.split(), root), shell_command("report", root)
        ),
        "absent",
    )


def rendering(record: Mapping[str, Any], consequence: str) -> Markup:
    """Return the noise of the rendering, from a scene record; empty if unknown.

    More than a tenth of a pixel's light (median over pixels) is a warning. The render stage
    measures it, on pixels without sky if there are any.
    """
    noise = record.get("monte_carlo")
    if not noise or not noise["median_relative"]:
        return Markup("")
    relative, photons = noise["median_relative"], number(noise["equivalent_photons_per_pixel"])
    is_noisy = relative > _CAUTION
    text = Markup(
        "{}The rendering is as noisy as {} photons per pixel ({} of a pixel’s light, median over "
        "pixels). {}"
    ).format(
        Markup("<b>Caution: noisy rendering.</b> ") if is_noisy else "",
        photons,
        percent(relative),
        consequence,
    )
    return html.paragraph(text, "warn" if is_noisy else "note")


def pivoted(label: str, corner: str, cells: Iterable[tuple[str, str, str]]) -> Markup:
    """Return a table of (row, column, text), with a dash for missing cells; empty without any."""
    texts = {(row, column): text for row, column, text in cells}
    rows = dict.fromkeys(row for row, _ in texts)
    columns = dict.fromkeys(column for _, column in texts)
    lines = [[row, *(texts.get((row, column), UNDEFINED) for column in columns)] for row in rows]
    return html.table(label, [corner, *columns], lines) if lines else Markup("")


def detector_section(report: Report) -> Section:
    """Return the section "Detector responses"; if detectors have not run, the command to run."""
    section = Section("Detector responses", name="detectors", link="Detectors")
    if not report.flow:
        missing = absent(report, "flow", "Motion detectors have not run yet.")
        return replace(section, body=missing)
    methods = [METHODS[name] for name in report.settings.methods]
    body = [rendering(report.scene, _FLICKER)]
    if report.shown.rim:
        body.append(images.wheel(report.shown.rim))
    for sensor in report.settings.sensors:
        records = [record for record in report.flow if record.sensor == sensor.name]
        rows = (_row(report, sensor, method) for method in methods)
        errors = html.heading("Error of the responses: ratio (literal)")
        body.append(html.card(sensor.name, *rows, errors, response_table(sensor.name, records)))
    body.append(html.paragraph(_ERRORS, "note"))
    settings, units = report.settings.flow, " or ".join(report.units)
    shares = [(truth.footprint.purity < settings.least_purity).mean() for truth in report.truths]
    text = _TRUTH.format(
        units,
        percent(float(np.mean(shares)) if shares else 0.0),
        percent(settings.least_purity),
        _MIXED[settings.mixed],
    )
    text = text if report.has_truth else _STAND_IN + text
    if tables := against_truth(report):
        title = html.heading(f"Against the {report.motion_name}")
        body.append(title + html.paragraph(text) + tables)
    guide = _GUIDE.format(report.frame + 1, " or ".join(report.units))
    return replace(section, text=guide, body=Markup("\n").join(body))


def _row(report: Report, sensor: ImageSensor, method: Detector) -> Markup:
    """Return a method's responses at every level, with the first sentence on it."""
    first = (type(method).__doc__ or "").strip().split("\n")[0].removeprefix(f"{method.name}: ")
    about = Markup("<b>{}</b> {}<br>{}{}").format(
        method.name, method.label, first[:1].upper(), first[1:]
    )
    levels = report.settings.light_levels
    pairs = [_pair(report, sensor, level, method) for level in levels]
    width = f"max-width:{260 * len(pairs)}px"
    return html.block("response", html.block("", about), html.block("pairs", *pairs, style=width))


def _pair(report: Report, sensor: ImageSensor, level: LightLevel, method: Detector) -> Markup:
    """Return the responses to the noise-free reading and to the counts, in the same colors."""
    path, name = responses_path(report.dataset, sensor, level), level_name(level)
    with undamaged(path, "run megalopta flow again with --redo"):
        responses = [
            np.asarray(StoredFrames.open(path, array).read([report.frame])[0], np.float64)
            for array in (f"{method.name}-ideal", method.name)
        ]
    if method.gives == "velocity":
        rim = report.shown.rim or 1.0
        smallest, nothing, legend = _PALE * rim, "no motion found", Markup("")
        pictures = [Image.fromarray(flow_to_rgb(response, rim)) for response in responses]
        responses = [np.hypot(*np.moveaxis(response, -1, 0)) for response in responses]
    else:
        known = responses[0][np.isfinite(responses[0])]
        bright = np.percentile(np.abs(known), _BRIGHT_PERCENTILE) if known.size else 0.0
        high = float(bright) or 1.0
        colors, low = ("RdBu_r", -high) if np.min(known, initial=0.0) < 0 else ("inferno", 0.0)
        scale = images.map_scale(colors, low, high, _ROOT)
        smallest, nothing, legend = 0.0, "no response", scale.legend(number(low), number(high))
        pictures = [scale.picture(report.shown.pixels(response)) for response in responses]
    kinds, shown = ("noise-free", f"from {sensor.unit}"), []
    for picture, response, kind in zip(pictures, responses, kinds, strict=True):
        largest = np.max(np.abs(response[np.isfinite(response)]), initial=0.0)
        alt = f"{method.name}, {name}, {kind}"
        shown.append(images.still(picture, kind, alt, "" if largest > smallest else nothing))
    return html.block("", html.paragraph(name), html.block("two", *shown), legend)


def response_table(sensor: str, records: Iterable[FlowRecord]) -> Markup:
    """Return ratio and literal errors on one sensor, and ratio errors to a perfect sensor."""
    cells = []
    for record in records:
        level, error = level_name(record.level), record.error
        text = f"{relative_error(error.ratio)} ({relative_error(error.literal)})"
        cells.append((record.method, level, UNDEFINED if error.ratio is None else text))
        if record.error_perfect:
            errors = filter(None, (record.error_perfect, record.error_corrected))
            ratios = " → ".join(relative_error(error.ratio) for error in errors)
            cells.append((record.method, f"{level}, to a perfect sensor", ratios))
    return pivoted(f"Errors of the responses on {sensor}", "Detector", cells)


def against_truth(report: Report) -> Markup:
    """Return errors and shares of outliers, a row per exposure and a column per method.

    The mean error is given as configured, with mixed pixels, and without them.
    """
    settings = report.settings.flow
    least = percent(settings.least_purity)
    has_mixtures = any(record.truth_by_mixture for record in report.flow)
    tables: dict[str, list[tuple[str, str, str]]] = {}
    for record in report.flow:
        texts: dict[str, str] = {}
        if mixture := record.truth_by_mixture:
            texts["Mean error (px), all pixels"] = _mean_error(mixture.all)
            label = f"Mean error (px), without mixed pixels (purity below {least})"
            texts[label] = _mean_error(mixture.without_mixed)
        if truth := record.truth:
            if settings.mixed == "weigh" or not has_mixtures:
                weighed = ", pixels weighted by purity" if has_mixtures else ""
                texts[f"Mean error (px){weighed}"] = _mean_error(truth)
            without = ", without mixed pixels" if settings.mixed == "leave_out" else ""
            stages = [truth.ideal, truth.counts, *filter(None, [truth.corrected])]
            outliers = (errors.outlier_fraction for errors in stages)
            texts[f"Outliers{without}"] = _in_turn(outliers, percent)
            medians = (errors.relative_error_median for errors in stages)
            texts["Median relative error"] = _in_turn(medians, relative_error)
        for label, text in texts.items():
            tables.setdefault(label, []).append((_exposure(record), record.method, text))
    return Markup("\n").join(pivoted(label, label, cells) for label, cells in tables.items())


def _exposure(record: FlowRecord) -> str:
    return f"{record.sensor}, {level_name(record.level)}"


def _mean_error(truth: TruthErrors) -> str:
    texts = []
    for errors in filter(None, (truth.ideal, truth.counts, truth.corrected)):
        relative, error_px = errors.relative_error_median, errors.endpoint_error_px
        fails = relative is not None and relative >= SENSELESS
        texts.append(None if error_px is None else FAILS if fails else number(error_px))
    return _in_turn(texts, str)


def _in_turn(values: Iterable[Value | None], text: Callable[[Value], str]) -> str:
    """Noise-free → counts → corrected counts."""
    return " → ".join(UNDEFINED if value is None else text(value) for value in values)


def threshold_section(report: Report) -> Section:
    """Return the section "Photons needed"; without a benchmark, the command to run."""
    section = Section("Photons needed", name="photons")
    if not report.benchmarks:
        missing = "The photon benchmark has not run yet."
        return replace(section, body=absent(report, "benchmark photons", missing))
    benchmark = report.benchmarks[0]
    settings, confidence = benchmark.settings, 100 * benchmark.settings.confidence
    # per pixel at each size: those of the original times the area ratio
    counts = settings.dark_counts * math.prod(benchmark.frames[1:])
    shapes = dict.fromkeys(curve.shape for curve in benchmark.curves)
    dark = (f"{short(counts / math.prod(shape))} at {_size(shape)} px" for shape in shapes)
    charts = []
    for shape in shapes:
        curves = [curve for curve in benchmark.curves if curve.shape == shape]
        for metric in settings.metrics:
            title = f"{_size(shape)} pixels, {metric} error"
            measured = [curve for curve in curves if curve.metric == metric]
            chart = error_chart(
                measured,
                report.exposures,
                f"curve-{shape[0]}-{metric}",
                f"Error over photons per frame at {title}, one curve per detector",
            )
            charts.append(html.card(title, chart))
    body = [
        html.block("pair", *charts),
        html.paragraph(_CURVES.format(benchmark.warm_up), "note"),
        html.heading(f"N_2b in photons per frame, with {confidence:g} % CI"),
        pivoted("N_2b in photons per frame", "Detector", _needs(report.benchmarks)),
        html.paragraph(_UNITS, "note"),
    ]
    text = _NEEDED.format(settings.repeats, ", ".join(dark))
    return replace(section, text=text, body=Markup("\n").join(body))


def _size(shape: Sequence[int]) -> str:
    return f"{shape[1]} × {shape[0]}"


def _needs(benchmarks: Sequence[BenchmarkResult]) -> Iterator[tuple[str, str, str]]:
    """Yield N_2b by method, size and metric, and by normalization where there are two."""
    for benchmark in benchmarks:
        normalized = f", {_NORMALIZED[benchmark.settings.normalization]} scaled"
        for curve in benchmark.curves:
            column = f"{_size(curve.shape)}, {curve.metric}"
            column += normalized if len(benchmarks) > 1 else ""
            yield curve.method, column, str(curve.thresholds.get(2, UNDEFINED))


@svg.in_style
def error_chart(
    curves: Sequence[ErrorCurve], budgets: Iterable[Budget], name: str, description: str
) -> Markup:
    """Draw error over photons per frame, a curve per method; NaN or 0 is a gap.

    Dotted lines are what sensors detect at a light level.
    """
    figure, axes = svg.new_axes(svg.CHART_PT[0], 300)
    fluxes = [flux for curve in curves[:1] for flux in curve.fluxes]
    for curve in curves:
        style = method_style(curve.method)
        spread = _BAND_STANDARD_ERRORS * np.array(curve.standard_errors)
        errors = svg.drawable(np.array(curve.errors))
        lower, upper = (np.clip(errors + sign * spread, 1e-9, None) for sign in (-1, 1))
        axes.fill_between(curve.fluxes, lower, upper, color=style["color"], alpha=0.2, linewidth=0)
        axes.plot(curve.fluxes, errors, **style, markersize=4, label=curve.method)
    axes.axhline(ACCURATE, color=BLACK, linewidth=1.2, linestyle="--")
    right: dict[str, Any] = {"textcoords": "offset points", "ha": "right", "fontsize": 10.5}
    place = {"xycoords": ("axes fraction", "data"), **right}
    axes.annotate(f"{percent(ACCURATE)} error", (1, ACCURATE), (-3, 3), **place)
    for budget in budgets:
        if fluxes and fluxes[0] <= (flux := budget.photons_per_frame) <= fluxes[-1]:
            axes.axvline(flux, color=BLACK, linewidth=1, linestyle=":")
            text = svg.verbatim(f"{budget.sensor.name}, {level_name(budget.level)}")
            place = {"xycoords": ("data", "axes fraction"), **right, "rotation": 90}
            axes.annotate(text, (flux, 1), (-2, -3), **place | {"va": "top", "fontsize": 9})
    svg.logarithmic(axes, "x", svg.NUMBERS)
    percents = FuncFormatter(
        lambda value, _: f"{100 * value:g} %" if value < 9.9 else f"{short(value)}×"
    )
    svg.logarithmic(axes, "y", percents)
    largest = max((float(np.nanmax(curve.errors, initial=1)) for curve in curves), default=1.0)
    axes.set(
        xlabel="photons per frame",
        ylabel="error of the response",
        ylim=(_SMALLEST_ERROR, min(_LARGEST_ERROR, 2 * max(largest, 1))),
    )
    return svg.with_legend(figure, name, description, loc="lower left")
