"""Sections on motion detectors: their errors, and the photons that they need.

A method with velocities is also compared with the true motion: a consistently wrong one is
perfectly repeatable. The others give a number without a unit, so the only test is whether their
response to counts equals that to the noise-free readings.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.ticker import FuncFormatter

from megalopta.core.errors import shell_command
from megalopta.dataset.flow_record import FlowRecord
from megalopta.flow.metrics.photon_threshold import ErrorCurve
from megalopta.report import sections as html, style as svg
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

ACCURATE = 0.25
"""The dissertation's 2-bit accuracy: an error below 2⁻²."""
_CAUTION = 0.1
_BAND_STANDARD_ERRORS = 2
_SMALLEST_ERROR, _LARGEST_ERROR = 1e-3, 1e3

_GUIDE = (
    "Each detector runs on the {}, and on their noise-free mean. The first tables compare motion "
    "with the true one, the last the two responses."
)
_FLICKER = (
    "This noise is the same in both responses, so it adds no error between them, but it adds to "
    "the errors against the true motion."
)
_ERRORS = Markup(
    "Readings are scaled to a mean of 1. Errors compare the "
    "response to counts with that to the noise-free reading, over all frames after the "
    "detectors have settled. <b>Ratio</b>: sum of all differences over sum of all responses. "
    "<b>Literal</b> (the dissertation's Eq. 4.5): mean of each pixel's quotient, dominated by the "
    "few responses near zero. <b>To a perfect sensor</b>: ratio error against the response to the "
    "mean of a perfect sensor, and that of corrected readings if there are any. “fails”: an error "
    "of ten times or more. A dash: the noise-free response shows no motion."
)
_TRUTH = (
    "Mean endpoint error of blocks, share of outliers (blocks with an error over 25 %), and median "
    "relative error: noise-free → on {} → on corrected readings if there are any. {} of the pixels "
    "shown are mixed: the object at their center fills less than {}. They count like all others."
)
_STAND_IN = (
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
    "Bands are ± 2 standard errors; errors of zero and beyond the axis are not drawn. The first {} "
    "frames, in which filters settle, are not scored. Dotted lines: photons that a sensor detects "
    "per frame at a light level. A curve that falls below 25 % on their left needs fewer photons, "
    "apart from the sensor’s dark readings."
)
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
    """Return the section "Detectors"; if detectors have not run, the command to run."""
    section = Section("Detectors", name="detectors")
    if not report.flow:
        missing = absent(report, "flow", "Motion detectors have not run yet.")
        return replace(section, body=missing)
    settings, units = report.settings.flow, " or ".join(report.units)
    body = [rendering(report.scene, _FLICKER)]
    if tables := against_truth(report):
        shares = [
            (truth.footprint.purity < settings.least_purity).mean() for truth in report.truths
        ]
        text = _TRUTH.format(
            units,
            percent(float(np.mean(shares)) if shares else 0.0),
            percent(settings.least_purity),
        )
        text = text if report.has_truth else _STAND_IN + text
        title = html.heading(f"Against the {report.motion_name}")
        body.append(title + html.paragraph(text) + tables)
    body.append(html.heading("Against the noise-free response: ratio error (literal)"))
    for sensor in report.settings.sensors:
        records = [record for record in report.flow if record.sensor == sensor.name]
        body.append(response_table(sensor.name, records))
    body.append(html.paragraph(_ERRORS, "note"))
    return replace(section, text=_GUIDE.format(units), body=Markup("\n").join(body))


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
    return pivoted(f"Errors of the responses on {sensor}", sensor, cells)


def against_truth(report: Report) -> Markup:
    """Return errors and shares of outliers, a row per exposure and a column per method."""
    tables: dict[str, list[tuple[str, str, str]]] = {}
    for record in report.flow:
        if (truth := record.truth) is None:
            continue
        exposure = f"{record.sensor}, {level_name(record.level)}"
        texts: dict[str, list[str]] = {}
        for errors in filter(None, (truth.ideal, truth.counts, truth.corrected)):
            relative, error_px = errors.relative_error_median, errors.endpoint_error_px
            fails = relative is not None and relative >= SENSELESS
            mean = UNDEFINED if error_px is None else FAILS if fails else number(error_px)
            texts.setdefault("Mean error (px)", []).append(mean)
            texts.setdefault("Outliers", []).append(percent(errors.outlier_fraction))
            texts.setdefault("Median relative error", []).append(relative_error(relative))
        for label, stages in texts.items():
            tables.setdefault(label, []).append((exposure, record.method, " → ".join(stages)))
    return Markup("\n").join(pivoted(label, label, cells) for label, cells in tables.items())


def threshold_section(report: Report) -> Section:
    """Return the section "Photons needed"; without a benchmark, the command to run."""
    section = Section("Photons needed", name="photons")
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
        charts.append(html.card(title, error_chart(curves, report.exposures, name, about)))
    needs = (
        (c.method, f"{_size(c.shape)}, {c.metric}", str(c.thresholds.get(2, UNDEFINED)))
        for c in benchmark.curves
    )
    body = [
        html.heading("N_2b in photons per frame, with 95 % CI"),
        pivoted("N_2b in photons per frame", "Detector", needs),
        html.paragraph(_UNITS, "note"),
        html.block("pair", *charts),
        html.paragraph(_CURVES.format(benchmark.warm_up), "note"),
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
    fluxes = [flux for curve in curves[:1] for flux in curve.fluxes]
    for curve in curves:
        style = method_style(curve.method)
        spread = _BAND_STANDARD_ERRORS * np.array(curve.standard_errors)
        errors = np.array(curve.errors)
        errors = np.where(errors > 0, errors, np.nan)
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
            sensor = budget.sensor.name.replace("$", r"\$")  # no mathematics
            text = f"{sensor}, {level_name(budget.level)}"
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
