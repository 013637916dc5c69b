"""Sections on motion detectors: their errors, and the photons that they need."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.ticker import FuncFormatter, LogLocator

from megalopta.core.errors import shell_command
from megalopta.core.quantities import UNDEFINED, number, percent, short
from megalopta.flow.metrics.photon_threshold import ErrorCurve
from megalopta.report import sections as html, style as svg
from megalopta.report.source import Budget, Report
from megalopta.report.text import level_name, relative_error

ACCURATE = 0.25
"""The dissertation's 2-bit accuracy: an error below 2⁻²."""

_ERRORS = Markup(
    "Readings are scaled to a mean of 1. Errors compare the response to counts with that to the "
    "noise-free reading, after the detectors have settled. <b>Ratio</b>: sum of all differences "
    "over sum of all responses. <b>Literal</b> (the dissertation's Eq. 4.5): mean of each pixel's "
    "quotient, dominated by the few responses near zero. <b>To a perfect sensor</b>: ratio error "
    "against the response to its mean, and that of corrected readings if there are any. “fails”: "
    "an error of ten times or more. A dash: the noise-free response shows no motion."
)
_TRUTH = (
    "Mean endpoint error of blocks, share of outliers (blocks with an error over 25 %), and median "
    "relative error: noise-free → on {} → on corrected readings if there are any. The object at "
    "the center of a mixed pixel fills less than {}; {} of the pixels shown are mixed."
)
STAND_IN = (
    "The true motion of pictures is unknown. The flow by DIS between the pictures without photon "
    "noise stands in for it, which favors DIS. "
)
_NEEDED = Markup(
    "How many photons per frame does a detector need to repeat its noise-free response within "
    "25 %, or 2 bits? The sequence is scaled to each number of photons and drawn {} times; "
    "N<sub>2b</sub> is where the error curve falls below 25 %. These pixels detect every photon "
    "and have dark counts in proportion to their area ({}, per frame)."
)
_CURVES = (
    "Bands are ± 2 standard errors. The first {} frames, in which filters settle, are not scored. "
    "Dotted lines: photons that a sensor detects per frame at a light level."
)
_INTERVALS = "Intervals are over draws of photons, not over scenes."


def absent(report: Report, stage: str, what: str) -> Markup:
    """Return the command to run for a missing stage."""
    root = report.dataset.root
    commands = shell_command(*stage.split(), root), shell_command("report", root)
    text = Markup("{} Run <code>{}</code> and then <code>{}</code>.").format(what, *commands)
    return html.paragraph(text, "absent")


def pivoted(label: str, corner: str, cells: Iterable[tuple[str, str, str]]) -> Markup:
    """Return a table of (row, column, text), with a dash for missing cells; empty without any."""
    texts = {(row, column): text for row, column, text in cells}
    rows = dict.fromkeys(row for row, _ in texts)
    columns = dict.fromkeys(column for _, column in texts)
    lines = [[row, *(texts.get((row, column), UNDEFINED) for column in columns)] for row in rows]
    return html.table(label, [corner, *columns], lines) if lines else Markup("")


def detector_section(report: Report) -> html.Section:
    """Return the section "Detectors"; if detectors have not run, the command to run."""
    section = html.Section("Error over light", name="detectors")
    if not report.flow:
        missing = absent(report, "flow", "Motion detectors have not run yet.")
        return replace(section, body=missing)
    settings, units, body = report.settings.flow, " or ".join(report.units), []
    if any(math.isfinite(record.median_error) for record in report.flow):
        photons = {budget.sensor.name: budget.photons for budget in report.exposures}
        most, least = (find(photons, key=photons.__getitem__) for find in (max, min))
        text = f"Each detector runs on the {units} of each sensor; below 25 % is good. "
        if photons[most] > 1.5 * photons[least]:
            text += (
                "Photons that reach a pixel are compared, as pixels differ: in the same light "
                f"{number(photons[most] / photons[least])} times as many reach one of {most} as "
                f"one of {least}."
            )
        body.append(html.block("wide", light_chart(report)))
        shares = [
            (truth.footprint.purity < settings.least_purity).mean() for truth in report.truths
        ]
        mixed = percent(float(np.mean(shares)) if shares else 0.0)
        meaning = _TRUTH.format(units, percent(settings.least_purity), mixed)
        meaning = html.paragraph(meaning if report.has_truth else STAND_IN + meaning)
        title = f"Errors against the {report.motion_name}"
        body.append(html.folded(title, meaning, against_truth(report)))
    else:
        text = f"Each detector runs on the {units}, and on their noise-free mean."
    tables: dict[str, list[tuple[str, str, str]]] = {}
    for record in report.flow:
        level, error = level_name(record.level), record.error
        response = f"{relative_error(error.ratio)} ({relative_error(error.literal)})"
        cells = tables.setdefault(record.sensor, [])
        cells.append((record.method, level, UNDEFINED if error.ratio is None else response))
        if record.error_perfect:
            stages = filter(None, (record.error_perfect, record.error_corrected))
            ratios = " → ".join(relative_error(stage.ratio) for stage in stages)
            cells.append((record.method, f"{level}, to a perfect sensor", ratios))
    losses = [
        pivoted(f"Errors of the responses on {sensor}", sensor, cells)
        for sensor, cells in tables.items()
    ]
    title = "What noise and device lose: ratio error (literal) against the noise-free response"
    body.append(html.folded(title, *losses, html.paragraph(_ERRORS, "note")))
    return replace(section, text=text, body=Markup("\n").join(body))


@svg.in_style
def light_chart(report: Report) -> Markup:
    """Draw the median error over photons on a pixel: a color per method, a dash per sensor."""
    figure, axes = svg.new_axes(svg.CHART_PT[0], 340)
    sensors = [sensor.name for sensor in report.settings.sensors]
    for method, (place, sensor) in product(report.settings.methods, enumerate(sensors)):
        errors = {
            record.level: record.median_error
            for record in report.flow
            if (record.method, record.sensor) == (method, sensor)
        }
        budgets = [budget for budget in report.of(sensor) if math.isfinite(errors[budget.level])]
        look = svg.method_style(method) | {"linestyle": svg.DASHES[place % len(svg.DASHES)]}
        if budgets:
            photons = [budget.photons for budget in budgets]
            median = [min(errors[budget.level], 10) for budget in budgets]
            axes.plot(photons, median, **look, label=f"{method}, {sensor}")
    axes.axhline(ACCURATE, color=svg.BLACK, linewidth=1.2, linestyle=":")
    svg.logarithmic(axes, "x", svg.NUMBERS)
    svg.logarithmic(axes, "y", FuncFormatter(lambda value, _: percent(value)))
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2.5, 5)))
    axes.set(xlabel="photons on a pixel in a frame", ylabel="median error of the flow")
    below: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.2), "ncols": 2}
    return svg.with_legend(figure, "light-chart", "Median error of the flow over light", **below)


def against_truth(report: Report) -> Markup:
    """Return errors and shares of outliers, a row per exposure and a column per method."""
    tables: dict[str, list[tuple[str, str, str]]] = {}
    for record in report.flow:
        if (truth := record.truth) is None:
            continue
        exposure = f"{record.sensor}, {level_name(record.level)}"
        stages = list(filter(None, (truth.ideal, truth.counts, truth.corrected)))
        columns = {
            "Mean error (px)": [number(errors.endpoint_error_px) for errors in stages],
            "Outliers": [percent(errors.outlier_fraction) for errors in stages],
            "Median relative error": [
                relative_error(errors.relative_error_median) for errors in stages
            ],
        }
        for label, texts in columns.items():
            tables.setdefault(label, []).append((exposure, record.method, " → ".join(texts)))
    return Markup("\n").join(pivoted(label, label, cells) for label, cells in tables.items())


def threshold_section(report: Report) -> html.Section:
    """Return the section "Photons needed"; without a benchmark, the command to run."""
    section = html.Section("Photons needed", name="photons")
    if (benchmark := report.benchmark) is None:
        missing = "The photon benchmark has not run yet."
        return replace(section, body=absent(report, "benchmark photons", missing))
    settings = benchmark.settings
    # per pixel at each size: those of the original times the area ratio
    counts = settings.dark_counts * math.prod(benchmark.frames[1:])
    shapes = dict.fromkeys(curve.shape for curve in benchmark.curves)
    dark = (f"{short(counts / math.prod(shape))} at {_size(shape)} px" for shape in shapes)
    charts = []
    for shape, metric in product(shapes, settings.metrics):
        curves = [c for c in benchmark.curves if (c.shape, c.metric) == (shape, metric)]
        title = f"{_size(shape)} pixels, {metric} error"
        about = f"Error over photons per frame at {title}, one curve per detector"
        name = f"curve-{shape[0]}-{metric}"
        chart = error_chart(curves, report.exposures, name, about)
        charts.append(html.block("card", html.heading(title), chart))
    needs = (
        (c.method, f"{_size(c.shape)}, {c.metric}", str(c.thresholds.get(2, UNDEFINED)))
        for c in benchmark.curves
    )
    body = [
        html.block("pair", *charts),
        html.paragraph(_CURVES.format(benchmark.warm_up), "note"),
        html.folded(
            "N_2b in photons per frame, with 95 % CI",
            pivoted("N_2b in photons per frame", "Detector", needs),
            html.paragraph(_INTERVALS, "note"),
        ),
    ]
    text = _NEEDED.format(settings.repeats, ", ".join(dark))
    return replace(section, text=text, body=Markup("\n").join(body))


def _size(shape: Sequence[int]) -> str:
    return f"{shape[1]} × {shape[0]}"


@svg.in_style
def error_chart(
    curves: Sequence[ErrorCurve], budgets: Iterable[Budget], name: str, description: str
) -> Markup:
    """Draw error over photons per frame, a curve per method; NaN or 0 is a gap.

    Dotted lines are what sensors detect at a light level.
    """
    figure, axes = svg.new_axes(svg.CHART_PT[0], 300)
    for curve in curves:
        look = svg.method_style(curve.method)
        errors = np.array(curve.errors)
        errors = np.where(errors > 0, errors, np.nan)
        spread = 2 * np.array(curve.standard_errors)
        ends = np.clip(errors - spread, 1e-9, None), errors + spread
        axes.fill_between(curve.fluxes, *ends, color=look["color"], alpha=0.2, linewidth=0)
        axes.plot(curve.fluxes, errors, **look, markersize=4, label=curve.method)
    axes.axhline(ACCURATE, color=svg.BLACK, linewidth=1.2, linestyle="--")
    near: dict[str, Any] = {"textcoords": "offset points", "ha": "right"}
    right = {"xycoords": ("axes fraction", "data"), "fontsize": 10.5, **near}
    axes.annotate(f"{percent(ACCURATE)} error", (1, ACCURATE), (-3, 3), **right)
    above = {"xycoords": ("data", "axes fraction"), "va": "top", "fontsize": 9, **near}
    for budget in budgets:
        flux = budget.photons_per_frame
        if curves and curves[0].fluxes[0] <= flux <= curves[0].fluxes[-1]:
            axes.axvline(flux, color=svg.BLACK, linewidth=1, linestyle=":")
            sensor = budget.sensor.name.replace("$", r"\$")  # no mathematics
            text = f"{sensor}, {level_name(budget.level)}"
            axes.annotate(text, (flux, 1), (-2, -3), rotation=90, **above)
    svg.logarithmic(axes, "x", svg.NUMBERS)
    percents = FuncFormatter(lambda value, _: percent(value) if value < 9.9 else f"{short(value)}×")
    svg.logarithmic(axes, "y", percents)
    largest = max((float(np.nanmax(curve.errors, initial=1)) for curve in curves), default=1.0)
    axes.set(
        xlabel="photons per frame",
        ylabel="error of the response",
        ylim=(1e-3, min(1e3, 2 * max(largest, 1))),
    )
    return svg.with_legend(figure, name, description, loc="lower left")
