"""The report's charts: light and signal, speed, error over photons, photons needed."""

import math
from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter
from matplotlib.typing import LineStyleType
from numpy.typing import NDArray

from megalopta.flow.metrics.photon_threshold import ErrorCurve, Threshold
from megalopta.plotting.style import BLACK, BLUE, DASHES, MARKERS, RULE, method_style, write_at
from megalopta.plotting.svg import CHART_PT, in_style, logarithmic, new_axes, to_svg
from megalopta.plotting.text import level_name, percent, short
from megalopta.report.source import Budget, by_sensor

Style = dict[str, Any]

_SPEED_BINS = 48
_BAND_STANDARD_ERRORS = 2
_SMALLEST_ERROR, _LARGEST_ERROR = 1e-3, 1e3

_NUMBERS = FuncFormatter(lambda value, _: short(value))
_ERRORS = FuncFormatter(
    lambda value, _: f"{100 * value:g} %" if value < 9.9 else f"{short(value)}×"
)


Needs = Mapping[str, Mapping[str, Threshold]]
"""Photons per frame that methods need, in each metric"""


@in_style
def signal_chart(budgets: Sequence[Budget], sensors: Sequence[str]) -> Markup:
    """Signal-to-noise ratio of a pixel over illuminance, a line per sensor."""
    figure, axes = new_axes(*CHART_PT)
    # Before anything is drawn: with nothing above zero to show, the axes keep their first limits.
    logarithmic(axes, "x", _NUMBERS)
    logarithmic(axes, "y", _NUMBERS)
    ranked = by_sensor(sorted(budgets, key=lambda each: each.illuminance_lux))
    for sensor, marker, dash in zip(sensors, cycle(MARKERS), cycle(DASHES), strict=False):
        own = ranked[sensor]
        lux = [each.illuminance_lux for each in own]
        low, median, high = _drawable(np.array([each.signal_to_noise for each in own])).T
        axes.plot(lux, median, marker, linestyle=dash, color=BLACK, label=_plain(sensor))
        axes.fill_between(lux, low, high, color=BLACK, alpha=0.12, linewidth=0)
    axes.axhline(1, color=BLACK, linewidth=1, linestyle=":", label="signal = noise")
    axes.set(xlabel="illuminance (lux)", ylabel="signal-to-noise ratio of a pixel")
    axes.legend(loc="upper left", frameon=False)
    return to_svg(figure, "signal", "Signal-to-noise ratio of a pixel over illuminance")


@in_style
def speed_chart(speeds: NDArray[np.floating], median: float) -> Markup:
    """Histogram of the true image speed (px per frame)."""
    figure, axes = new_axes(*CHART_PT)
    axes.hist(
        speeds,
        bins=_SPEED_BINS,
        weights=np.full(speeds.size, 100 / max(speeds.size, 1)),
        histtype="stepfilled",
        color=BLUE,
        alpha=0.85,
    )
    axes.axvline(median, color=BLACK, linewidth=1.2)
    top: Style = {"xycoords": ("data", "axes fraction"), "va": "top", "fontsize": 10.5}
    axes.annotate(f" median {median:.2g}", (median, 1), **top)
    axes.grid(axis="y")
    axes.set(xlabel="speed in the image (px per frame)", ylabel="share of pixels (%)")
    axes.set_xlim(0, None)
    return to_svg(figure, "speed", "Histogram of the true speed of the image")


@in_style
def error_chart(curves: Sequence[ErrorCurve], name: str, level: float, description: str) -> Markup:
    """Error over photons per frame, a curve per method with its interval; NaN or 0 is a gap."""
    figure, axes = new_axes(CHART_PT[0], 300)
    for curve in curves:
        style = method_style(curve.method)
        spread = _BAND_STANDARD_ERRORS * np.array(curve.standard_errors)
        errors = _drawable(np.array(curve.errors))
        lower, upper = (np.clip(errors + sign * spread, 1e-9, None) for sign in (-1, 1))
        axes.fill_between(curve.fluxes, lower, upper, color=style["color"], alpha=0.2, linewidth=0)
        axes.plot(curve.fluxes, errors, **style, markersize=4)
    axes.axhline(level, color=BLACK, linewidth=1.2, linestyle="--")
    right: Style = {"xycoords": ("axes fraction", "data"), "ha": "right", "fontsize": 10.5}
    write_at(axes, f"{percent(level)} error", (1, level), (-3, 3), **right)
    logarithmic(axes, "x", _NUMBERS)
    logarithmic(axes, "y", _ERRORS)
    largest = max((float(np.nanmax(each.errors, initial=1)) for each in curves), default=1.0)
    axes.set(
        xlabel="photons per frame",
        ylabel="error of the response",
        ylim=(_SMALLEST_ERROR, min(_LARGEST_ERROR, 2 * max(largest, 1))),
    )
    return to_svg(figure, name, description)


@in_style
def threshold_chart(
    methods: Needs, budgets: Sequence[Budget], chart: str, description: str
) -> Markup:
    """Photons each method needs, beside the photons each sensor detects at each light level.

    Filled markers are the first metric, open ones the others.
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
    axes.set_yticks(places, map(_plain, [*supplies, *methods]))
    axes.tick_params(axis="y", length=0)
    logarithmic(axes, "x", _NUMBERS)
    axes.grid(visible=False)
    axes.set_xlabel("photons per frame")
    if supplies:
        axes.axhline(first - 0.65, color=RULE, linewidth=0.8)
    return to_svg(figure, chart, description)


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
        name = _plain(level_name(budget.level))
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


def _drawable(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what a logarithmic axis can show, with gaps elsewhere."""
    return np.where(values > 0, values, np.nan)


def _plain(text: str) -> str:
    """Text for matplotlib as it stands, dollar signs included."""
    return text.replace("$", r"\$")
