"""Pages of comparisons: of uniform light, of a scene, and of the plate."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray
from scipy.stats import norm

from megalopta.core.arrays import Floats
from megalopta.report import style
from megalopta.report.sections import Section, captioned
from megalopta.report.style import BLACK, BLUE, VERMILION
from megalopta.report.text import number, with_error
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.compare.recordings import FALSE_ALARMS, Comparison
from megalopta.sensor.compare.two_sample import Difference

Levels = Sequence[Level]

_HEAD = ("", "captured", "simulated", "difference", "95 % CI", "p", "verdict")
_LARGEST_Z = 6.0
_FAULTS = (
    "Steadiness in time, order of the pixels, rows and columns, single pixels and codes of the "
    "ADC, before any parameter is fitted. What is found is taken out or masked in all that follows."
)
_TESTS = (
    "Tests of every pixel that is left, at every level; false discovery rate by Benjamini and "
    "Hochberg. Captured and simulated maps share a scale. The third map is their difference in "
    "standard errors of counting and calibration: pale grain is chance; strong colors, rows, "
    "columns or patches are a difference of the device. Gray pixels are saturated, or have too few "
    "counts."
)
_TRANSFER = (
    "Where captured points lie on simulated ones, device and model respond alike to motion; the "
    "table gives the significance."
)
_FRAMES_SHOWN = 200
_MOST_POINTS = 2000
"""Most points in a picture; of a larger array, evenly spaced pixels."""
_STYLES: tuple[dict[str, Any], ...] = (
    {"label": "captured", "color": BLUE, "marker": "o"},
    {"label": "simulated", "color": VERMILION, "marker": "x"},
)


class Compared(NamedTuple):
    """Captured recordings, simulations of the same stimuli, and their differences."""

    captured: Levels
    simulated: Levels
    found: Comparison
    correlation: float = 0.0
    """Correlation of the frames of a scene with their aligned simulation"""


class SpeedResponse(NamedTuple):
    """Peak responses of one detector at one speed, captured and simulated, per crossing."""

    name: str
    speed_mm_s: float
    captured: Floats
    """(crossings,), mean over rows and detectors of the array."""
    simulated: Floats
    difference: Difference


class Page(NamedTuple):
    """Content of a page."""

    title: str
    sentence: str
    """Summary"""
    sections: list[Section]


def levels_page(name: str, compared: Compared) -> Page:
    """Return the differences of captured from simulated levels, with pictures."""
    comparison = compared.found
    explained, order = comparison.explained, comparison.arrangement
    if not explained.alone:
        explanation = "Frames are not independent, or no pixel is left: none is tested."
    elif not explained.is_different:
        explanation = "Means, variances and coincidences do not differ significantly."
    elif not explained.accepted:
        explanation = "No one or two of them explain the difference."
    else:
        sets = (f"{' and '.join(each.names)} (p = {each.p:.2g})" for each in explained.accepted)
        explanation = f"The difference is explained by {', or else by '.join(sets)}."
    faults = Section(
        "Faults",
        f"{_FAULTS} The image is {order.name}: rank correlation of the two patterns "
        f"{order.correlation:.3f}. Found: {'; '.join(map(str, comparison.faults)) or 'none'}.",
    )
    device = _differences(
        "The device",
        "Parameters that explain the rest, each fitted together with those that differ. "
        f"{explanation} At most {100 * FALSE_ALARMS:g} % of comparisons of a device with itself "
        f"raise a false alarm. “Equivalent”: a difference below {100 * comparison.margin:g} % (two "
        "one-sided tests at 95 %).",
        comparison,
    )
    lights = [
        "Dark" if level.is_dark else f"{number(level.light_hz)} photons/s per pixel"
        for level in compared.captured
    ]
    title = f"{name}: captured and simulated"
    return Page(title, comparison.sentence, [faults, device, *_pixels(compared, lights)])


def scene_page(name: str, compared: Compared) -> Page:
    """Return the differences of a captured from a simulated scene, with pictures."""
    comparison = compared.found
    in_time = captioned(
        _time_chart(compared.captured[0], compared.simulated[0]),
        "Coincident curves saw the same frames of the scene; a horizontal shift is a difference "
        "in time, a vertical one a difference in brightness.",
    )
    scene = _differences(
        "The scene",
        f"Frames are aligned in time by correlation ({compared.correlation:.2f}), "
        "and the matching frames are simulated. Quantities are compared in blocks of frames; "
        f"differences below {100 * comparison.margin:g} % are ignored.",
        comparison,
    )
    sections = [scene, Section("In time", charts=(in_time,)), *_pixels(compared, ["Frames"])]
    return Page(f"{name}: captured and simulated", comparison.sentence, sections)


def motion_page(name: str, responses: Sequence[SpeedResponse]) -> Page:
    """Return the differences of responses to a moving plate."""
    limit = FALSE_ALARMS / len(responses)
    differences = [each.difference for each in responses]
    real = sorted((each for each in differences if each.p < limit), key=lambda each: -each.size)
    sentence = f"Captured: {'; '.join(map(str, real[:3]))}." if real else ""
    charts = (captioned(_response_chart(responses, each), _TRANSFER) for each in ("NDM", "NDS"))
    sections = [
        Section(
            "Transfer functions",
            "Mean and standard deviation over crossings, each of 32 captured frames around a "
            "passing edge.",
            charts=tuple(charts),
        ),
        Section(
            "Responses",
            "Peak responses to the edge.",
            _HEAD,
            tuple(_cells(each, each.p < limit) for each in differences),
        ),
    ]
    title = f"{name}: responses to a moving plate"
    return Page(title, sentence or "No significant difference.", sections)


def _differences(title: str, text: str, found: Comparison) -> Section:
    rows = (_cells(each, each in found.significant) for each in found.differences)
    return Section(title, text, _HEAD, tuple(rows))


def _cells(each: Difference, differs: bool) -> tuple[str, ...]:
    verdicts = {"differs": differs, "equivalent": each.is_equivalent}
    sizes = each.captured, each.expected
    return (
        each.name if each.unit == "s" else f"{each.name} ({each.unit})",
        *(with_error(size, 0, "s") if each.unit == "s" else number(size) for size in sizes),
        f"{100 * each.relative:+.2g} %{each.base}",
        f"{100 * each.low:+.2g} to {100 * each.high:+.2g} %",
        f"{each.p:.2g}",
        " and ".join(word for word, holds in verdicts.items() if holds) or "inconclusive",
    )


def _pixels(compared: Compared, lights: Sequence[str]) -> Iterator[Section]:
    """Yield sections on the differences of pixels, level by level, titled by their lights."""
    captured, simulated, comparison = compared.captured, compared.simulated, compared.found
    yield Section("Distributions", charts=tuple(_curves(captured, simulated)))
    counted = tuple(
        (name, str(int(np.isfinite(test.p).sum())), str(int(test.differs.sum())))
        for name, test in comparison.tests.items()
    )
    text = f"{_TESTS} Alarms: {'; '.join(comparison.alarms) or 'none'}."
    yield Section("Pixels", text, ("quantity", "tested", "differ"), counted)
    for at, (one, other) in enumerate(zip(captured, simulated, strict=True)):
        means, variances = (comparison.tests[name] for name in ("mean", "variance"))
        maps = [each.readings.mean(axis=0) for each in (one, other)]
        yield Section(
            f"{lights[at]}, {with_error(one.exposure_s, 0, 's')}",
            f"Of {np.isfinite(means.p[at]).sum()} pixels {means.differs[at].sum()} differ in the "
            f"mean, {variances.differs[at].sum()} in the variance.",
            charts=tuple(_maps(at, maps, means.p[at])),
        )


def _curves(captured: Levels, simulated: Levels) -> Iterator[Markup]:
    yield captioned(
        _transfer_chart(captured, simulated),
        "Photon transfer, a point per pixel and level. Coincident clouds have the same step and "
        "noise; a higher one has a larger step or more crosstalk.",
    )
    dark = [pair for pair in zip(captured, simulated, strict=True) if pair[0].is_dark]
    if dark:
        yield captioned(
            _dark_chart(*max(dark, key=lambda pair: pair[0].exposure_s)),
            "Distribution of dark counts over pixels. A horizontal shift is a difference in "
            "temperature or excess bias; a difference at the end only is one of hot pixels.",
        )


def _maps(at: int, maps: Sequence[Floats], p: Floats) -> Iterator[Markup]:
    """Yield maps of the mean at one level: captured, simulated, and their difference."""
    limits = style.color_limits(*maps)
    for values, label in zip(maps, ("captured", "simulated"), strict=True):
        yield style.map_chart(values, f"mean-{at}-{label}", f"mean, {label} (counts)", limits)
    apart = np.sign(maps[0] - maps[1]) * norm.isf(p / 2)
    title = "mean, captured minus simulated (standard errors)"
    yield style.map_chart(apart, f"mean-{at}-apart", title, (-_LARGEST_Z, _LARGEST_Z), "PuOr")


@style.in_style
def _transfer_chart(captured: Levels, simulated: Levels) -> Markup:
    """Draw variance of pixels over their mean."""
    figure, axes = style.new_axes(*style.CHART_PT)
    for levels, line in zip((captured, simulated), _STYLES, strict=True):
        for place, level in enumerate(levels):
            shown = _thinned(level.readings.reshape(len(level.readings), -1).T)
            look = line | {"label": "" if place else line["label"]}
            axes.plot(shown.mean(axis=1), shown.var(axis=1), markersize=2.5, linewidth=0, **look)
    axes.set(xlabel="mean counts", ylabel="variance (counts²)", xscale="symlog", yscale="symlog")
    return style.with_legend(
        figure, "transfer", "Photon transfer: variance over mean", markerscale=2
    )


@style.in_style
def _dark_chart(captured: Level, simulated: Level) -> Markup:
    """Draw the distribution of dark counts over pixels."""
    figure, axes = style.new_axes(*style.CHART_PT)
    for level, line in zip((captured, simulated), _STYLES, strict=True):
        rates = np.maximum(level.readings.mean(axis=0) / level.exposure_s, 1e-3)
        shares = (np.arange(rates.size) + 0.5) / rates.size
        look = line | {"marker": ""}
        axes.plot(_thinned(np.sort(rates, axis=None)), _thinned(shares), **look)
    axes.set(xscale="log", xlabel="dark counts (Hz)", ylabel="cumulative share of pixels")
    return style.with_legend(figure, "dark", "Distribution of dark counts over the pixels")


@style.in_style
def _time_chart(captured: Level, simulated: Level) -> Markup:
    """Draw mean counts of frames over time."""
    figure, axes = style.new_axes(1.5 * style.CHART_PT[0], 0.8 * style.CHART_PT[1])
    for frames, line in zip((captured, simulated), _STYLES, strict=True):
        means = frames.readings[:_FRAMES_SHOWN].mean(axis=(1, 2))
        axes.plot(means, **line | {"marker": ""})
    axes.set(xlabel="frame", ylabel="mean counts")
    outside = {"loc": "lower right", "bbox_to_anchor": (1, 1), "ncols": 2}
    return style.with_legend(figure, "time", "Mean counts of frames", **outside)


@style.in_style
def _response_chart(responses: Sequence[SpeedResponse], method: str) -> Markup:
    """Draw a transfer function: peak response over speed, mean and standard deviation."""
    figure, axes = style.new_axes(*style.CHART_PT)
    shown = [each for each in responses if each.name == method]
    speeds = [each.speed_mm_s for each in shown]
    sides = [each.captured for each in shown], [each.simulated for each in shown]
    for values, line in zip(sides, _STYLES, strict=True):
        means, spreads = zip(*((each.mean(), each.std(ddof=1)) for each in values), strict=True)
        axes.errorbar(speeds, means, spreads, capsize=3, markersize=4, **line)
    axes.axhline(0, color=BLACK, linewidth=0.5)
    unit = shown[0].difference.unit
    axes.set(xlabel="speed (mm/s)", ylabel=f"peak response ({unit})", title=method)
    return style.with_legend(figure, f"response-{method}", f"Transfer function of {method}")


def _thinned(values: NDArray[Any]) -> NDArray[Any]:
    return values[:: max(1, len(values) // _MOST_POINTS)]
