"""`megalopta spadcam compare`: pages on uniform light, a scene or the plate."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from numpy.typing import NDArray
from scipy.stats import norm

from megalopta.camera.comparison import (
    Compared,
    SpeedResponse,
    captured_frames,
    compare_levels,
    compare_scene,
    plate_responses,
    rendered_dataset,
)
from megalopta.camera.recording import Beam, Source, read_recorded
from megalopta.camera.stimuli import Rendered
from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError, refused_as
from megalopta.report.sections import Section, captioned, write_sections
from megalopta.report.style import (
    BLACK,
    BLUE,
    CHART_PT,
    VERMILION,
    color_limits,
    in_style,
    map_chart,
    new_axes,
    with_legend,
)
from megalopta.report.text import number
from megalopta.sensor import PRESETS, Sensor, load_sensor
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.compare.quantities import SEGMENT, segment_spectra
from megalopta.sensor.compare.recordings import FALSE_ALARMS, MARGIN, Comparison
from megalopta.sensor.compare.two_sample import Difference

Levels = Sequence[Level]
Sources = Sequence[Source]

_HEAD = ("", "captured", "simulated", "difference", "95 % CI", "p", "verdict")
_LARGEST_Z = 6.0
_FAULTS = (
    "Steadiness in time, rows and columns, single pixels and codes of the ADC, before any "
    "parameter is fitted. What is found is taken out or masked in all that follows."
)
_TESTS = (
    "Tests of every pixel that is left, at every level; false discovery rate by Benjamini and "
    "Hochberg. The maps show the pixels that differ."
)
_DISTANCES = (
    "Distance of a pixel's two histograms, median over pixels and levels, and the same by chance, "
    "after a random permutation of both recordings' frames."
)
_MAPS = (
    "Captured and simulated maps share a scale. The third map is their difference in standard "
    "errors of counting and calibration, as tested above: pale grain is chance; strong colors, "
    "rows, columns or patches are a difference of the device. Gray pixels are saturated, or have "
    "too few counts."
)
_TRANSFER = (
    "Where captured points lie on simulated ones, device and model respond alike to motion; the "
    "table gives the significance."
)


Page = tuple[str, str, list[Section]]
"""Title, summary and sections"""


def _levels_page(name: str, compared: Compared) -> Page:
    """Return the differences of captured from simulated levels, with pictures."""
    found = compared.found
    order = found.arrangement
    lines = order.rows or order.columns
    rows = f" In their order: {', '.join(map(str, lines))}." if lines else ""
    faults = Section(
        "Faults",
        f"{_FAULTS} Found: {'; '.join(map(str, found.faults)) or 'none'}.",
    )
    device = _differences(
        "The device",
        f"Parameters that explain the rest, each fitted together with those that differ. "
        f"{_explained(found)} At most {100 * FALSE_ALARMS:g} % of comparisons of a device with "
        f"itself raise a false alarm. “Equivalent”: a difference below {100 * found.margin:g} % "
        "(two one-sided tests at 95 %).",
        found,
    )
    pixels = Section(
        "Order of the pixels",
        f"The captured image is {order.name}: rank correlation of the two patterns "
        f"{order.correlation:.3f}.{rows}",
    )
    title = f"{name}: captured and simulated"
    return title, found.sentence, [faults, device, pixels, *_pixels(compared)]


def _explained(found: Comparison) -> str:
    """Say how well the parameters explain the difference."""
    explained = found.explained
    if not explained.alone:
        return "Frames are not independent, or no pixel is left: none is tested."
    if not explained.is_different:
        return "Means, variances and coincidences do not differ significantly."
    if not explained.accepted:
        return "No one or two of them explain the difference."
    sets = (f"{' and '.join(each.names)} (p = {each.p:.2g})" for each in explained.accepted)
    return f"The difference is explained by {', or else by '.join(sets)}."


def _scene_page(name: str, compared: Compared) -> Page:
    """Return the differences of a captured from a simulated scene, with pictures."""
    found = compared.found
    in_time = captioned(
        time_chart(compared.captured[0], compared.simulated[0]),
        "Coincident curves saw the same frames of the scene; a horizontal shift is a difference "
        "in time, a vertical one a difference in brightness.",
    )
    scene = _differences(
        "The scene",
        f"Frames are aligned in time by correlation ({compared.correlation:.2f}), "
        "and the matching frames are simulated. Quantities are compared in blocks of frames; "
        f"differences below {100 * found.margin:g} % are ignored.",
        found,
    )
    title, shown = f"{name}: captured and simulated", Section("In time", charts=(in_time,))
    return title, found.sentence, [scene, shown, *_pixels(compared)]


def motion_page(name: str, responses: Sequence[SpeedResponse]) -> Page:
    """Return the differences of responses to a moving plate."""
    limit = FALSE_ALARMS / len(responses)
    differences = [each.difference for each in responses]
    real = sorted((each for each in differences if each.p < limit), key=lambda each: -each.size)
    differs = f"Captured: {'; '.join(map(str, real[:3]))}."
    charts = (captioned(response_chart(responses, method), _TRANSFER) for method in ("NDM", "NDS"))
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
    sentence = differs if real else "No significant difference."
    return f"{name}: responses to a moving plate", sentence, sections


def _differences(title: str, text: str, found: Comparison) -> Section:
    differ = found.significant
    return Section(
        title, text, _HEAD, tuple(_cells(each, each in differ) for each in found.differences)
    )


def _cells(each: Difference, differs: bool) -> tuple[str, ...]:
    verdicts = {"differs": differs, "equivalent": each.is_equivalent}
    return (
        f"{each.name} ({each.unit})",
        number(each.captured),
        number(each.expected),
        f"{100 * each.relative:+.2g} %{each.base}",
        f"{100 * each.low:+.2g} to {100 * each.high:+.2g} %",
        f"{each.p:.2g}",
        " and ".join(word for word, holds in verdicts.items() if holds) or "inconclusive",
    )


def _pixels(compared: Compared) -> Iterator[Section]:
    """Yield sections on the differences of pixels, level by level."""
    captured, simulated, found = compared.captured, compared.simulated, compared.found
    counted = (
        (name, str(int(np.isfinite(test.p).sum())), str(int(test.differs.sum())))
        for name, test in found.tests.items()
    )
    yield Section("Pixels", _TESTS, ("quantity", "tested", "differ"), tuple(counted))
    distances = zip(found.distances._asdict().items(), ("share", "counts", "counts^½"), strict=True)
    apart = (
        (
            f"{name.replace('_', ' ').capitalize()} ({unit})",
            number(float(np.median(each))),
            number(float(np.median(getattr(found.by_chance, name)))),
        )
        for (name, each), unit in distances
    )
    head = ("distance", "captured and simulated", "by chance")
    yield Section("Histograms", _DISTANCES, head, tuple(apart))
    yield Section("Alarms", f"{'; '.join(found.alarms) or 'None'}.")
    yield Section("Distributions", charts=tuple(_curves(captured, simulated, found)))
    yield Section("Maps", _MAPS)
    for at, levels in enumerate(zip(captured, simulated, strict=True)):
        yield _maps(at, *levels, found)


def _curves(captured: Levels, simulated: Levels, found: Comparison) -> Iterator[Markup]:
    yield captioned(
        transfer_chart(captured, simulated),
        "Photon transfer, a point per pixel and level. Coincident clouds have the same step and "
        "noise; a higher one has a larger step or more crosstalk.",
    )
    yield captioned(
        spectrum_chart(captured[-1], simulated[-1]),
        "Temporal spectrum of the last recording. Flat: independent frames; power at low "
        "frequencies: drift; a peak: hum or flicker.",
    )
    dark = [at for at, level in enumerate(captured) if level.is_dark]
    if dark:
        at = max(dark, key=lambda place: captured[place].exposure_s)
        yield captioned(
            dark_chart(captured[at], simulated[at]),
            "Distribution of dark counts over pixels. A horizontal shift is a difference in "
            "temperature or excess bias; a difference at the end only is one of hot pixels.",
        )
    yield captioned(
        distance_chart(found),
        "Distances of the histograms above. Where the curves diverge, pixels differ more than "
        "by chance; at bright levels, errors of the calibration alone may be the cause.",
    )


def _maps(at: int, one: Level, other: Level, found: Comparison) -> Section:
    """Return maps of mean and variance at one level: captured, simulated, and their difference."""
    means, variances = (found.tests[name] for name in ("mean", "variance"))
    both = one.readings, other.readings
    return Section(
        f"{'Dark' if one.is_dark else f'Light {one.light_hz:g}'}, {one.exposure_s:g} s",
        f"Of {np.isfinite(means.p[at]).sum()} pixels {means.differs[at].sum()} differ in the mean, "
        f"{variances.differs[at].sum()} in the variance.",
        charts=(
            *_map_row("mean", at, "counts", [each.mean(axis=0) for each in both], means.p[at]),
            *_map_row(
                "variance", at, "counts²", [each.var(axis=0) for each in both], variances.p[at]
            ),
        ),
    )


def _map_row(
    quantity: str, at: int, unit: str, maps: Sequence[Floats], p: Floats
) -> Iterator[Markup]:
    limits, name = color_limits(*maps), f"{quantity}-{at}"
    for values, label in zip(maps, ("captured", "simulated"), strict=True):
        yield map_chart(values, f"{name}-{label}", f"{quantity}, {label} ({unit})", limits)
    apart = np.sign(maps[0] - maps[1]) * norm.isf(p / 2)
    title = f"{quantity}, captured minus simulated (standard errors)"
    yield map_chart(apart, f"{name}-apart", title, (-_LARGEST_Z, _LARGEST_Z), "PuOr")


@dataclass(frozen=True)
class CompareSettings:
    """Settings of a comparison."""

    scene: str = "levels"
    """"levels": darkness and uniform light; "plate": the plate of the motion bench; or the folder
    of a dataset, or a configuration, which is rendered into a folder next to the page."""
    beam: Beam = field(default_factory=Beam)
    margin: float = MARGIN
    """Relative difference to ignore."""
    seed: int = 0
    """Seed of the simulation."""
    own_light: bool = False
    """For the scene "plate": simulate in the light that each recording shows, instead of the
    dissertation's."""


def compare_captured(sources: Sources, device: Path, out: Path, asked: CompareSettings) -> str:
    """Write the report, an HTML page; return the main differences in a sentence.

    Sources have a light each; for "plate", a speed (mm/s) instead; for a dataset, a light level
    (lux), 0: that of the rendering. Raises UserError if the device file or recordings cannot be
    read, or do not match.
    """
    make = {"levels": _with_levels, "plate": _with_plate}.get(asked.scene, _with_scene)
    with refused_as("compare"):
        model = PRESETS.get(str(device)) or load_sensor(device)
        title, sentence, sections = make(sources, model, out, asked)
    write_sections(out, title, sentence, sections)
    return sentence


def _with_levels(sources: Sources, sensor: Sensor, _: Path, asked: CompareSettings) -> Page:
    beam = asked.beam
    captured = [
        captured_frames(read_recorded(source), sensor, beam.photons_hz(source.light, sensor))
        for source in sources
    ]
    compared = compare_levels(captured, sensor, beam, asked.margin, asked.seed)
    return _levels_page(sensor.name, compared)


def _with_plate(sources: Sources, sensor: Sensor, _: Path, asked: CompareSettings) -> Page:
    plates = {
        source.light: captured_frames(read_recorded(source), sensor, source.light)
        for source in sources
    }
    responses = plate_responses(plates, sensor, asked.margin, asked.seed, own_light=asked.own_light)
    return motion_page(sensor.name, responses)


def _with_scene(sources: Sources, sensor: Sensor, out: Path, asked: CompareSettings) -> Page:
    dataset = rendered_dataset(asked.scene, out.with_suffix(""))
    if len(sources) != 1:
        raise UserError(f"compare: {len(sources)} recordings of {dataset}; give one at a time")
    (source,) = sources
    captured = captured_frames(read_recorded(source), sensor, source.light or 1.0)
    cycle = Rendered(dataset, source.light or None).film(sensor)
    compared = compare_scene(captured, cycle, sensor, asked.margin, asked.seed)
    return _scene_page(dataset.name, compared)


_FRAMES_SHOWN = 200
_MOST_POINTS = 2000
"""Most points in a picture; of a larger array, evenly spaced pixels."""
_STYLES = (
    {"label": "captured", "color": BLUE, "marker": "o"},
    {"label": "simulated", "color": VERMILION, "marker": "x"},
)


@in_style
def transfer_chart(captured: Levels, simulated: Levels) -> Markup:
    """Draw variance of pixels over their mean."""
    figure, axes = new_axes(*CHART_PT)
    for levels, style in _beside(captured, simulated):
        for place, level in enumerate(levels):
            shown = _thinned(level.readings.reshape(len(level.readings), -1).T)
            own = style | {"label": "" if place else style["label"]}
            axes.plot(shown.mean(axis=1), shown.var(axis=1), markersize=2.5, linewidth=0, **own)
    axes.set(xlabel="mean counts", ylabel="variance (counts²)", xscale="symlog", yscale="symlog")
    return with_legend(figure, "transfer", "Photon transfer: variance over mean", markerscale=2)


@in_style
def dark_chart(captured: Level, simulated: Level) -> Markup:
    """Draw the distribution of dark counts over pixels."""
    figure, axes = new_axes(*CHART_PT)
    for level, style in _beside(captured, simulated):
        rates = level.readings.mean(axis=0) / level.exposure_s
        _draw_shares(axes, np.maximum(rates, 1e-3), style)
    axes.set(xscale="log", xlabel="dark counts (Hz)", ylabel="cumulative share of pixels")
    return with_legend(figure, "dark", "Distribution of dark counts over the pixels")


@in_style
def spectrum_chart(captured: Level, simulated: Level) -> Markup:
    """Draw the temporal spectrum of the readings, mean over pixels."""
    figure, axes = new_axes(*CHART_PT)
    for level, style in _beside(captured, simulated):
        power = segment_spectra(level.readings).mean(axis=0)[1:]
        axes.plot(np.arange(1, power.size + 1) / SEGMENT, power, **_line(style))
    axes.set(xlabel="cycles per frame", ylabel="power (counts²)", ylim=(0, None))
    return with_legend(figure, "spectrum", "Temporal spectrum of readings, captured and simulated")


@in_style
def distance_chart(found: Comparison) -> Markup:
    """Draw the distribution of energy distances over pixels, and the same by chance."""
    figure, axes = new_axes(*CHART_PT)
    _draw_shares(axes, found.distances.energy, {"label": "captured and simulated", "color": BLUE})
    _draw_shares(axes, found.by_chance.energy, {"label": "by chance", "color": VERMILION})
    axes.set(xlabel="energy distance (counts$^{1/2}$)", ylabel="cumulative share of pixels")
    axes.set_xlim(left=0)
    return with_legend(figure, "distance", "Energy distances of histograms, over the pixels")


@in_style
def time_chart(captured: Level, simulated: Level) -> Markup:
    """Draw mean counts of frames over time."""
    figure, axes = new_axes(1.5 * CHART_PT[0], 0.8 * CHART_PT[1])
    for frames, style in _beside(captured, simulated):
        axes.plot(frames.readings[:_FRAMES_SHOWN].mean(axis=(1, 2)), **_line(style))
    axes.set(xlabel="frame", ylabel="mean counts")
    outside = {"loc": "lower right", "bbox_to_anchor": (1, 1), "ncols": 2}
    return with_legend(figure, "time", "Mean counts of frames, captured and simulated", **outside)


@in_style
def response_chart(responses: Sequence[SpeedResponse], method: str) -> Markup:
    """Draw a transfer function: peak response over speed, mean and standard deviation."""
    figure, axes = new_axes(*CHART_PT)
    own = [each for each in responses if each.name == method]
    speeds = [each.speed_mm_s for each in own]
    for values, style in _beside([each.captured for each in own], [each.simulated for each in own]):
        means, spreads = zip(*((each.mean(), each.std(ddof=1)) for each in values), strict=True)
        axes.errorbar(speeds, means, spreads, capsize=3, markersize=4, **style)
    axes.axhline(0, color=BLACK, linewidth=0.5)
    unit = own[0].difference.unit
    axes.set(xlabel="speed (mm/s)", ylabel=f"peak response ({unit})", title=method)
    return with_legend(figure, f"response-{method}", f"Transfer function of {method}")


def _beside(captured: Any, simulated: Any) -> Iterator[tuple[Any, dict[str, Any]]]:
    """Yield captured and simulated values, each with its style."""
    return zip((captured, simulated), _STYLES, strict=True)


def _line(style: dict[str, Any]) -> dict[str, Any]:
    return style | {"marker": ""}


def _draw_shares(axes: Axes, values: Floats, style: dict[str, Any]) -> None:
    """Draw the cumulative distribution of values."""
    shares = (np.arange(values.size) + 0.5) / values.size
    axes.plot(_thinned(np.sort(values, axis=None)), _thinned(shares), **_line(style))


def _thinned(values: NDArray[Any]) -> NDArray[Any]:
    return values[:: max(1, len(values) // _MOST_POINTS)]
