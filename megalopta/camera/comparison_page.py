"""Pages of comparisons: of uniform light, of a scene, and of the plate."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup
from matplotlib.ticker import FixedLocator
from numpy.typing import NDArray
from scipy.stats import norm

from megalopta.core.arrays import Floats
from megalopta.core.quantities import number, short, with_error
from megalopta.report import style
from megalopta.report.sections import Section, block, captioned, folded, heading, paragraph, table
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.compare.causes import REFUTED
from megalopta.sensor.compare.recordings import FALSE_ALARMS, Comparison, agreement
from megalopta.sensor.compare.two_sample import Difference, Sample

Levels = Sequence[Level]

_LARGEST_Z, _MOST = (-6.0, 6.0), 3.0
"""Largest standard errors, and relative differences, that charts show"""
_GUIDE = (
    "95 % CI. Gray: too small to matter; beyond it, the axis is logarithmic. “of”: a typical size."
)
_TESTS = "False discovery rate (Benjamini-Hochberg). Gray: named, saturated, or of too few counts."
_TRANSFER = "A point per pixel and level. A higher cloud has a larger step or more crosstalk."
_DARK = "A shift to the right is warmer, or of more bias; a difference at the end is of hot pixels."
_LEFT = (
    "No known cause explains this. A pattern in the map is one of rows, columns or light; a course "
    "or a line in time is one of the light, the clock or the readout."
)
_SPECTRUM = (
    "1: independent frames. A line is periodic; a rise to the left is slow, as lag or traps."
)
_MOST_POINTS = 2000
"""Most points in a picture; of a larger array, evenly spaced pixels."""
_STYLES: tuple[dict[str, Any], ...] = (
    {"label": "captured", "color": style.BLUE, "marker": "."},
    {"label": "simulated", "color": style.VERMILION, "marker": "x", "linestyle": "--"},
)


class SpeedResponse(NamedTuple):
    """Peak responses of one detector at one speed, captured and simulated, per crossing."""

    name: str
    speed_mm_s: float
    captured: Floats
    """(crossings,), mean over rows and detectors of the array."""
    simulated: Floats
    difference: Difference


Page = tuple[str, str, list[Section]]
"""Title, summary and sections"""


def levels_page(name: str, comparison: Comparison) -> Page:
    """Return the differences of captured from simulated levels, with pictures."""
    order, accepted = comparison.arrangement, comparison.explained.accepted
    sets = [
        f"{' and '.join(causes.names)} (goodness of fit: p = {causes.p:.2g})" for causes in accepted
    ]
    faults, explanation = "; ".join(map(str, comparison.faults)), ""
    if sets:
        what = "The rest" if faults else "The difference"
        explanation = f"{what} is explained by {', or else by '.join(sets)}. "
    if accepted and accepted[0].p < REFUTED:
        explanation += "A small p: something weaker is left, which no known cause explains. "
    explanation = (
        f"{f'Found first, and taken out: {faults}. ' if faults else ''}{explanation}The image is "
        f"{order.name}: the rank correlation of the two patterns is {order.correlation:.3f}."
    )
    device = _differences(
        "The device",
        explanation,
        "Each parameter is fitted together with those that differ. One that “explains too little” "
        "fits better with another value, but simulations with it still differ from the frames. "
        f"At most {100 * FALSE_ALARMS:g} % of comparisons of a device with itself "
        f"raise a false alarm. “Equivalent”: a difference below {100 * comparison.margin:g} % (two "
        "one-sided tests at 95 %).",
        *(comparison.differences, comparison.significant, comparison.margin),
    )
    lights = [
        "Dark" if level.is_dark else f"{short(level.light_hz)} photons/s per pixel"
        for level in comparison.captured
    ]
    title = f"{name}: captured and simulated"
    left = [_left(comparison)] if comparison.left else []
    return title, comparison.sentence, [*left, device, *_pixels(comparison, lights)]


def _left(comparison: Comparison) -> Section:
    """Return what nothing explains: the largest statistics, and a picture of the first."""
    left = sorted(comparison.left, key=lambda statistic: -statistic.z)[:8]
    rows = [(largest.name, str(largest.level), f"{largest.z:.0f}") for largest in left]
    lights = [(level.light_hz, level.exposure_s) for level in comparison.captured]
    at = lights.index((left[0].level.light_hz, left[0].level.exposure_s))
    captured, simulated = comparison.compared[at]
    first, second = Sample.of(captured.signal), Sample.of(simulated.signal)
    spread = np.sqrt(first.variance / first.frames + second.variance / second.frames)
    z = (first.mean - second.mean) / np.maximum(spread, 1e-9)
    title = "mean, captured minus simulated (standard errors)"
    charts = (
        captioned(style.map_chart(z, "left-map", title, _LARGEST_Z, "PuOr"), f"At {captured}."),
        captioned(_time_chart(captured, simulated, "left-time"), "Means of frames, in time."),
        captioned(_spectrum_chart(captured, simulated), _SPECTRUM),
    )
    head = ("what differs beyond the named causes", "recording", "standard errors")
    return Section("What is left", _LEFT, charts=charts, body=table("Largest first", head, rows))


def _spectrum_chart(captured: Level, simulated: Level) -> Markup:
    """Draw the mean spectrum of pixels, relative to independent frames."""
    curves = []
    for level in (captured, simulated):
        frames = _thinned(level.signal.reshape(len(level.signal), -1).T).T
        z = (frames - frames.mean(axis=0)) / np.maximum(frames.std(axis=0), 1e-9)
        power = np.square(np.abs(np.fft.rfft(z, axis=0)[1:])).mean(axis=1) / len(z)
        curves.append((np.arange(1, len(power) + 1) / len(z), power))
    labels = {"yscale": "log", "xlabel": "cycles per frame", "ylabel": "mean power of pixels"}
    return _curves(curves, "left-spectrum", "Mean spectrum of pixels in time", labels)


def scene_page(name: str, comparison: Comparison, correlation: float) -> Page:
    """Return the differences of a captured from a simulated scene, with pictures."""
    in_time = captioned(
        _time_chart(comparison.captured[0], comparison.expected[0]),
        "Coincident curves saw the same frames of the scene; a horizontal shift is a difference "
        "in time, a vertical one a difference in brightness.",
    )
    scene = _differences(
        "The scene",
        f"Frames are aligned in time by correlation ({correlation:.2f}), "
        "and the matching frames are simulated.",
        "Quantities are compared in blocks of frames; differences below "
        f"{100 * comparison.margin:g} % are ignored.",
        *(comparison.differences, comparison.significant, comparison.margin),
    )
    sections = [scene, Section("In time", charts=(in_time,)), *_pixels(comparison, ["Frames"])]
    return f"{name}: captured and simulated", comparison.sentence, sections


def motion_page(name: str, responses: Sequence[SpeedResponse], margin: float) -> Page:
    """Return the differences of responses to a moving plate."""
    differences = [response.difference for response in responses]
    limit = FALSE_ALARMS / len(responses)
    real = [difference for difference in differences if difference.p < limit]
    largest = sorted(real, key=lambda difference: -difference.size)[:3]
    sentence = f"The captured device differs: {'; '.join(map(str, largest))} (95 % CI)."
    if not real:
        sentence = f"{agreement('responses', differences)}."
    about = "Mean and standard deviation over crossings of 32 frames around a passing edge."
    charts = tuple(_response_chart(responses, method) for method in ("NDM", "NDS"))
    sections = [
        Section("Transfer functions", about, charts=charts),
        _differences("Responses", "Peak responses to the edge.", "", differences, real, margin),
    ]
    return f"{name}: responses to a moving plate", sentence, sections


def _differences(
    title: str, text: str, note: str, differences: Sequence[Difference],
    significant: Sequence[Difference], margin: float,
) -> Section:  # fmt: skip
    """Return differences with their intervals as a picture, and folded as a table."""
    if not differences:
        return Section(title, text)
    rows = []
    for change in differences:
        verdicts = {"differs": change in significant, "equivalent": change.is_equivalent}
        otherwise = "explains too little" if change.p < 1e-4 else "too uncertain"
        is_time, is_shown = change.unit == "s", change.high - change.low < 20
        sizes = [
            with_error(size, 0, "s") if is_time else number(size)
            for size in (change.captured, change.expected)
        ]
        amount = f"{'+' * (change.relative > 0)}{change.relative_text}{change.base}"
        cells = (
            change.name if is_time else f"{change.name} ({change.unit})",
            " and ".join(word for word, holds in verdicts.items() if holds) or otherwise,
            amount if is_shown else "these recordings do not show it",
            *(sizes if is_shown else ("–", sizes[1])),
            "< 0.0001" if change.p < 1e-4 else f"{change.p:.2g}",
        )
        rows.append(cells)
    head = ("", "verdict", "difference (± 95 % CI)", "captured", "simulated", "p")
    chart = captioned(_difference_chart(title, differences, significant, margin), _GUIDE)
    body = folded("Values and verdicts", table(title, head, rows), paragraph(note, "note"))
    return Section(title, text, charts=(chart,), body=body)


@style.in_style
def _difference_chart(
    title: str, differences: Sequence[Difference], significant: Sequence[Difference], margin: float
) -> Markup:
    """Draw relative differences with their intervals, a line per quantity."""
    figure, axes = style.new_axes(440, 60 + 26 * len(differences))
    axes.axvspan(-100 * margin, 100 * margin, color=style.GRAY, alpha=0.2, linewidth=0)
    axes.axvline(0, color=style.BLACK, linewidth=0.5)
    for place, change in enumerate(differences):
        color = style.VERMILION if change in significant else style.BLUE
        size, *ends = np.clip([change.relative, change.low, change.high], -_MOST, _MOST) * 100
        axes.plot(ends, (place, place), color=color, linewidth=1.5, marker="|", markersize=9)
        axes.plot(size, place, marker="o", color=color, markersize=3)
    names = [
        f"{one.name} {one.relative_text}{one.base}" if one.high - one.low < 20 else one.name
        for one in differences
    ]
    axes.set_yticks(range(len(differences)), names)
    axes.set(ylim=(len(differences) - 0.5, -0.5), xlabel="captured more than simulated (%)")
    axes.set_xscale("symlog", linthresh=100 * margin, linscale=2)
    axes.set_xlim(-100 * _MOST, 100 * _MOST)
    axes.xaxis.set_major_locator(FixedLocator((-100, -20, -5, 0, 5, 20, 100)))
    axes.xaxis.set_major_formatter(style.NUMBERS)
    return style.to_svg(figure, f"differences-{title.split()[-1]}", f"Differences of {title}")


def _pixels(comparison: Comparison, lights: Sequence[str]) -> Iterator[Section]:
    """Yield sections on the differences of pixels, level by level, titled by their lights."""
    captured, simulated = comparison.captured, comparison.expected
    means, variances = (comparison.tests[name] for name in ("mean", "variance"))
    text = "Maps and tests are of frames without what the first sentence names: faults are taken "
    text += "out, and the fitted device is simulated again. Charts above show it as calibrated."
    if not (comparison.faults or comparison.explained.accepted) or np.isnan(means.p).all():
        text = ""
    curves = [captioned(_transfer_chart(captured, simulated), _TRANSFER)]
    dark = [pair for pair in zip(captured, simulated, strict=True) if pair[0].is_dark]
    if dark:
        longest = max(dark, key=lambda pair: pair[0].exposure_s)
        curves.append(captioned(_dark_chart(*longest), _DARK))
    yield Section("Distributions", charts=tuple(curves))
    parts = []
    for place, levels in enumerate(comparison.compared):
        p, maps = means.p[place], [level.readings.mean(axis=0) for level in levels]
        limits, charts = style.color_limits(*maps), []
        for values, label in zip(maps, ("captured", "simulated"), strict=True):
            title = f"mean, {label} (counts)"
            charts.append(style.map_chart(values, f"mean-{place}-{label}", title, limits))
        z = np.where(means.is_more[place], 1, -1) * norm.isf(p / 2)
        title = "mean, captured minus simulated (standard errors)"
        charts.append(style.map_chart(z, f"mean-{place}-difference", title, _LARGEST_Z, "PuOr"))
        parts += [
            heading(f"{lights[place]}, {with_error(levels[0].exposure_s, 0, 's')}"),
            paragraph(
                f"Of {many} pixels {means.differs[place].sum()} differ in the "
                f"mean, {variances.differs[place].sum()} in the variance."
                if (many := np.isfinite(p).sum())
                else "Pixels are tested once what is named is mended."
            ),
            block("charts", *charts),
        ]
    yield Section("Pixels", text, body=Markup("\n").join([*parts, paragraph(_TESTS, "note")]))


@style.in_style
def _transfer_chart(captured: Levels, simulated: Levels) -> Markup:
    figure, axes = style.new_axes(*style.CHART_PT)
    for levels, line in zip((simulated, captured), _STYLES[::-1], strict=True):
        for place, level in enumerate(levels):
            shown = _thinned(level.readings.reshape(len(level.readings), -1).T, 400)
            look = line | {"label": "" if place else line["label"], "alpha": 0.5}
            moments = shown.mean(axis=1), shown.var(axis=1)
            axes.plot(*moments, markersize=3, linewidth=0, rasterized=True, **look)
    axes.set(xlabel="mean counts", ylabel="variance (counts²)")
    if max(level.readings.max() for level in captured) > 1:
        axes.set(xscale="symlog", yscale="symlog")
    return style.with_legend(
        figure, "transfer", "Photon transfer: variance over mean", markerscale=2
    )


def _dark_chart(captured: Level, simulated: Level) -> Markup:
    curves = []
    for level in (captured, simulated):
        rates = np.sort(np.maximum(level.readings.mean(axis=0) / level.exposure_s, 1e-3), axis=None)
        curves.append((_thinned(rates), _thinned((np.arange(rates.size) + 0.5) / rates.size)))
    labels = {"xscale": "log", "xlabel": "dark counts (Hz)", "ylabel": "cumulative share of pixels"}
    return _curves(curves, "dark", "Distribution of dark counts over the pixels", labels)


def _time_chart(captured: Level, simulated: Level, name: str = "time") -> Markup:
    means = [level.readings[:200].mean(axis=(1, 2)) for level in (captured, simulated)]
    labels = {"xlabel": "frame", "ylabel": "mean counts"}
    curves = [(np.arange(len(mean)), mean) for mean in means]
    return _curves(curves, name, "Mean counts of frames", labels)


@style.in_style
def _curves(
    curves: Sequence[tuple[NDArray[Any], Floats]], name: str, description: str, labels: Any
) -> Markup:
    """Draw the curves (x, y) of what was captured and of what was simulated."""
    figure, axes = style.new_axes(*style.CHART_PT)
    for curve, line in zip(curves, _STYLES, strict=True):
        axes.plot(*curve, **line | {"marker": ""})
    axes.set(**labels)
    above = {"loc": "lower right", "bbox_to_anchor": (1, 1), "ncols": 2}
    return style.with_legend(figure, name, description, **above)


@style.in_style
def _response_chart(responses: Sequence[SpeedResponse], method: str) -> Markup:
    """Draw a transfer function: peak response over speed, mean and standard deviation."""
    figure, axes = style.new_axes(*style.CHART_PT)
    shown = [response for response in responses if response.name == method]
    speeds = [response.speed_mm_s for response in shown]
    for side, line in zip(("captured", "simulated"), _STYLES, strict=True):
        peaks = [getattr(response, side) for response in shown]
        means, spreads = [values.mean() for values in peaks], [v.std(ddof=1) for v in peaks]
        axes.errorbar(speeds, means, spreads, capsize=3, markersize=4, **line)
    axes.axhline(0, color=style.BLACK, linewidth=0.5)
    unit = shown[0].difference.unit
    axes.set(xlabel="speed (mm/s)", ylabel=f"peak response ({unit})", title=method)
    return style.with_legend(figure, f"response-{method}", f"Transfer function of {method}")


def _thinned(values: NDArray[Any], most: int = _MOST_POINTS) -> NDArray[Any]:
    return values[:: max(1, len(values) // most)]
