"""The report of a dataset: its opening with results, its light, its motion, and how it was made."""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup
from matplotlib.ticker import EngFormatter
from numpy.typing import NDArray

from megalopta import __version__
from megalopta.config.model import LightLevel
from megalopta.config.yaml_model import to_yaml
from megalopta.core.progress import duration
from megalopta.dataset.store import Dataset
from megalopta.report import images, sections as html, style as svg
from megalopta.report.detectors import (
    ACCURATE,
    absent,
    detector_section,
    rendering,
    threshold_section,
)
from megalopta.report.sections import Section
from megalopta.report.source import Budget, Report
from megalopta.report.style import BLACK, BLUE
from megalopta.report.text import (
    level_name,
    level_title,
    number,
    percent,
    title,
)
from megalopta.scenes import Pictures
from megalopta.scenes.levels import illuminance_of
from megalopta.sensor import CtiaSensor, ImageSensor
from megalopta.sensor.spad.counters import LARGEST_CAPACITY
from megalopta.sensor.spad.model import active_effects

_MOST_LEVELS = 4
_SPEED_BINS = 48
_BACKDROP_GRAY = 0.35

_OUTCOME = ("sensor", "best method", "within 25 % down to", "median error there")
"""Heads of the table of results"""
_STAND_IN = (
    "Within 25 % of the flow by DIS between the clean pictures, a stand-in for the unknown true "
    "motion that favors DIS."
)
_LIGHT = (
    "Each sensor is exposed to the same light, scaled to each level; a named level has its own "
    "spectrum. A reading with mean N scatters by about √N; an integrating pixel adds dark current, "
    "reset and read noise. Orange pixels are saturated: their readings are lower bounds. "
)
_INSTANT = "Every frame is rendered at one instant, without motion blur."
_PICTURE = (
    "The light of a picture is constant during an exposure, unless sub_frames says otherwise."
)
_COLUMNS = Markup(
    "Means over pixels and frames, per pixel and exposure. <b>Detected</b>: photons that release a "
    "pulse or an electron. <b>Dark</b>: readings without light. <b>Expected</b>: noise-free mean "
    "after dead time. <b>Signal-to-noise</b> (median over pixels): the light's contribution to a "
    "reading over the reading's standard deviation. <b>Rendering : shot noise</b>: ratio of "
    "standard deviations; above 1, the rendering is noisier than the photons."
)
_SECONDS = EngFormatter("s")
_BIASES = {"fixed": "fixed", "dac": "converter (non-adaptive)", "floating_gate": "floating gate"}
_MOTION = "The median speed is {:.2g} px per frame; {} of the pixels are hidden in the next frame."
_PICTURES_MOTION = (
    "The true motion of pictures is unknown. A stand-in replaces it: the flow by DIS between them "
    "without photon noise. Its median speed is {:.2g} px per frame."
)
_DEPTH = (
    "Depth is measured {}; its colors are logarithmic. Orange pixels are occluded in the next "
    "frame. Every object has its own color."
)
_MADE = (
    "The settings below, with their seeds, reproduce everything on this page. Only the noise of "
    "rendering may differ between machines."
)


def write_report(dataset: Dataset) -> Path:
    """Write DATASET/report.html from the finished stages; return its path.

    Raises UserError if nothing was rendered yet, or a file cannot be read.
    """
    report = Report(dataset)
    shown, frames = report.shown, report.settings.trajectory.frames
    pixels = f"one of {shown.step} × {shown.step} pixels and " if shown.step > 1 else ""
    return html.write_sections(
        dataset.root / "report.html",
        title(report.settings),
        lead(report),
        [make(report) for make in SECTIONS],
        header=_opening(report),
        film=report.film(),
        footer=(
            f"Written by megalopta {__version__}. Pictures show {pixels}{len(shown.frames)} of "
            f"{frames} frames; the last one has no next frame, so no motion."
        ),
    )


def lead(report: Report) -> str:
    """Return a paragraph on scene, camera and sensors."""
    settings, scene, levels = report.settings, report.settings.scene, report.settings.light_levels
    *others, last = (sensor.name for sensor in settings.sensors)
    sensors = f"{', '.join(others)} and {last}" if others else last
    if isinstance(scene, Pictures):
        pictures = report.scene["pictures"]
        about = (
            f"{pictures['transfer']} codes are converted to light; white has the spectrum of "
            f"{scene.white_name(settings.light)}, and the mean reflectance is "
            f"{percent(scene.reflectance)}. {percent(pictures['saturated'])} of the pixels are "
            "saturated in the file."
        )
    else:
        about = (
            f"The {settings.camera} {settings.trajectory}. Every frame is rendered as "
            "spectral radiance, together with its exact motion."
        )
    return (
        f"{scene.describe()} {about} The light becomes readings of {sensors} at {len(levels)} "
        f"light level{'s'[: len(levels) != 1]}, from which motion detectors estimate the motion."
    )


def facts(report: Report) -> Iterator[tuple[str, str]]:
    """Yield facts: names and numbers."""
    camera, trajectory = report.settings.camera, report.settings.trajectory
    yield f"frames of {camera.width} × {camera.height} px", f"{trajectory.frames}"
    for what, count in report.settings.scene.counts.items():
        yield what, f"{count:,}"
    for what in ("objects", "triangles"):
        if number := report.scene.get(what):
            yield what, f"{number:,}"
    if light := report.scene.get("illuminance"):
        yield "illuminance in the open, as rendered", f"{light['unshaded_lux']:.3g} lux"
        if ground := [point["lux"] for point in light["ground"]]:
            mean = sum(ground) / len(ground)
            yield "illuminance on the ground below the camera", f"{mean:.2g} lux"
    if report.has_truth:
        objects = np.unique([truth.object_id for truth in report.truths])
        yield "objects in view at any time", f"{np.count_nonzero(objects):,}"
    if report.shown.rim:
        yield "px per frame, median speed", f"{report.median_speed:.2g}"
    yield "frames per second", f"{trajectory.frame_rate_hz:g}"


class _Reached(NamedTuple):
    """Errors of a method at one light level, against the reference motion."""

    illuminance_lux: float
    error: float
    """Median over the blocks, relative"""
    method: str
    """Name, with ", corrected" on corrected readings"""
    level: LightLevel
    outliers: float
    """Share of blocks that are off by more than 25 %"""


def _reached(report: Report, sensor: str) -> _Reached | None:
    """Return the best method in the least light at which one is accurate.

    Where none is, it is the one with the least error at any light.
    """
    errors = [
        _Reached(
            illuminance_of(record.level),
            errors.relative_error_median,
            f"{record.method}{ending}",
            record.level,
            errors.outlier_fraction or 0.0,
        )
        for record in report.flow
        if record.sensor == sensor and record.truth
        for ending, errors in (("", record.truth.counts), (", corrected", record.truth.corrected))
        if errors and errors.relative_error_median is not None
    ]
    accurate = [reached for reached in errors if reached.error < ACCURATE]
    return min(accurate) if accurate else min(errors, key=lambda one: one.error, default=None)


def _opening(report: Report) -> Markup:
    """Return key numbers and results."""
    numbers = list(facts(report))
    # per row, for rows of nearly equal length
    many, few = (math.ceil(len(numbers) / math.ceil(len(numbers) / most)) for most in (8, 4))
    tiles = html.block("", html.definitions("facts", numbers), style=f"--many:{many};--few:{few}")
    if not report.exposures:
        return tiles
    names = [sensor.name for sensor in report.settings.sensors]
    best = {name: reached for name in names if (reached := _reached(report, name))}
    accurate = {name: reached for name, reached in best.items() if reached.error < ACCURATE}
    sensor, sentence = names[0], ""
    if accurate:
        sensor, reached = min(accurate.items(), key=lambda pair: pair[1])
        sentence = (
            f"{reached.method} on {sensor} stays within 25 % of the {report.motion_name} down to "
            f"{level_title(reached.level)}: the median error of its blocks is "
            f"{percent(reached.error)}, and {percent(reached.outliers)} of them are off by more "
            "than 25 %."
        )
    elif report.flow:
        sentence = f"No method stays within 25 % of the {report.motion_name} at any level."
    rows = []
    for name, reached in best.items():
        level, error = level_name(reached.level), percent(reached.error)
        reach = (level, error) if name in accurate else ("none", f"{error} at {level}")
        rows.append((name, reached.method, *reach))
    shown, frames = report.shown, report.shown.frames
    budgets = report.of(sensor)
    films = [images.film(None, "light", "The scene's light, tone-mapped")]
    films += [_counts_film(report, one) for one in images.evenly_spaced(budgets, _MOST_LEVELS)]
    if flow := shown.found_flow(budgets[0].sensor, budgets[0].level):
        films.append(flow.film(frames, f"{flow.name} at {flow.level}"))
    if shown.rim:
        films.append(shown.motion(report.motion_name).film(frames))
    return tiles + html.block(
        "outcome",
        Markup("<h2>Results</h2>"),
        html.paragraph(sentence),
        html.block("strip", *films),
        html.table("Results", _OUTCOME, rows) if rows else Markup(""),
        html.paragraph("" if report.has_truth or not report.flow else _STAND_IN, "note"),
    )


def _counts_film(report: Report, budget: Budget) -> Markup:
    """Return the readings of an exposure as a film, with their scale."""
    panel = report.shown.readings(budget.sensor, budget.level)
    return panel.film(report.shown.frames, f"{panel.name} of {panel.sensor}, {panel.level}")


def light_section(report: Report) -> Section:
    """Return the section "From light to counts"; without counts, the command to run."""
    section = Section(
        f"From light to {' and '.join(report.units)}",
        name="light",
        link=f"Light to {report.units[0]}",
    )
    if not report.exposures:
        missing = absent(report, "sense", "No sensor has been exposed yet.")
        return replace(section, body=missing)
    shutter, cards = report.settings.shutter, []
    if not report.has_truth:
        timing = _PICTURE
    elif shutter.is_instant:
        timing = _INSTANT
    else:
        line = ("column", "row")[shutter.across]
        timing = (
            f"Frames and true motion are those of the shutter, blurred by the motion during "
            f"{shutter.exposure_s or 0:g} s and read out {line} by {line} from the "
            f"{shutter.readout_from} within {shutter.readout_s or 0:g} s."
        )
    for sensor in report.settings.sensors:
        about = " · ".join(f"{name} {value}" for name, value in _properties(sensor))
        budgets = report.of(sensor.name)
        films = (_counts_film(report, budget) for budget in budgets)
        light = images.film(None, "radiance", "The scene's light, tone-mapped")
        cards.append(
            html.card(
                sensor.name,
                html.paragraph(f"{about}.", "note"),
                html.block("strip", light, *films),
                _budget_table(sensor, budgets),
            )
        )
    body = Markup("\n").join([*cards, html.paragraph(_COLUMNS, "note")])
    return replace(section, text=_LIGHT + timing, body=body)


def _properties(sensor: ImageSensor) -> Iterator[tuple[str, str]]:
    """Yield properties of a sensor by name: pixel, efficiency, exposure, readout, effects."""
    curve = sensor.efficiency
    best = int(np.argmax(curve.values))
    yield "pixels of", f"{1e6 * sensor.pitch_m:.3g} µm"
    yield "fill factor", percent(sensor.fill_factor)
    where = f" at {curve.wavelengths_nm[best]:g} nm" if len(set(curve.values)) > 1 else ""
    yield "efficiency", f"{percent(curve.values[best])}{where}"
    yield "exposure", _SECONDS(sensor.exposure_s)
    if isinstance(sensor, CtiaSensor):
        yield "capacitance", f"{1e12 * sensor.capacitance_f:g} pF"
        yield "swing", f"{sensor.swing_v:g} V"
        yield "bias of the diodes", _BIASES[sensor.bias.kind]
        return
    yield "dead time", f"{_SECONDS(sensor.dead_time.dead_time_s)} ({sensor.dead_time.kind})"
    if sensor.counter_capacity < LARGEST_CAPACITY:
        yield "counter up to", f"{sensor.counter_capacity:,}"
    yield "effects:", ", ".join(name.replace("_", " ") for name in active_effects(sensor))


def _budget_table(sensor: ImageSensor, budgets: Iterable[Budget]) -> Markup:
    """Return the photon budget, a row per light level."""
    head = (
        "Light",
        "Photons on the pixel",
        "Detected",
        f"Dark {sensor.unit}",
        f"Expected {sensor.unit}",
        "Signal-to-noise",
        "Saturated",
        "Rendering : shot noise",
    )
    rows = (
        (
            level_title(budget.level),
            number(budget.photons),
            number(budget.detected),
            number(budget.dark),
            number(budget.expected),
            number(budget.signal_to_noise),
            percent(budget.saturated_fraction),
            number(budget.rendering_noise),
        )
        for budget in budgets
    )
    return html.table(f"Photon budget of {sensor.name}", head, rows)


def motion_section(report: Report) -> Section:
    """Return the section "True motion"; for pictures, with the stand-in for it."""
    shown, settings = report.shown, report.settings
    films = [shown.motion(report.motion_name).film(shown.frames)] if shown.rim else []
    films += _truth_films(report) if report.has_truth else []
    body = html.block("strip", *films)
    if shown.rim:
        depth = _DEPTH.format(settings.camera.depth_meaning) if report.has_truth else ""
        guide = html.block("", images.wheel(shown.rim), html.paragraph(depth, "note"))
        chart = html.card("Image speed", speed_chart(report.speed, report.median_speed))
        body += html.block("pair", guide, chart)
    if not report.has_truth:
        text = _PICTURES_MOTION.format(report.median_speed)
        return Section("Motion of the pictures", text, body=body, name="motion", link="Motion")
    if not shown.rim:
        text = "A single frame has no motion; its depth and objects are known exactly."
        return Section("Truth", text, body=body, name="motion")
    hidden = float(np.mean([truth.occluded_forward.mean() for truth in report.truths]))
    text = _MOTION.format(report.median_speed, percent(hidden))
    return Section("True motion", text, body=body, name="motion")


def _truth_films(report: Report) -> list[Markup]:
    """Return depth, occlusion, purity and objects as films."""
    shown, truths = report.shown, report.truths
    films = [shown.depth.film(shown.frames)]
    if shown.rim:
        hidden = []
        for frame, truth in zip(shown.frames, truths, strict=True):
            gray = np.asarray(shown.light.picture(frame).convert("L")) * _BACKDROP_GRAY
            picture = np.repeat(gray[..., np.newaxis], 3, axis=-1).astype(np.uint8)
            picture[shown.pixels(truth.occluded_forward)] = images.ORANGE
            hidden.append(images.rgb_picture(picture))
        alt = "Occluded pixels in orange"
        films.append(images.film(hidden, "occluded in the next frame", alt))
    scale = images.map_scale("viridis", 0.0, 1.0)
    purity = [scale.picture(shown.pixels(truth.footprint.purity)) for truth in truths]
    alt = "Share of each pixel filled by the object at its center"
    films.append(images.film(purity, "purity", alt, scale.legend("0", "1")))
    objects = [images.id_picture(shown.pixels(truth.object_id)) for truth in truths]
    alt = "Each object in its own color, the sky dark"
    return [*films, images.film(objects, "objects", alt)]


@svg.in_style
def speed_chart(speeds: NDArray[np.floating], median: float) -> Markup:
    """Draw the histogram of the true image speed (px per frame)."""
    figure, axes = svg.new_axes(*svg.CHART_PT)
    weights = np.full(speeds.size, 100 / max(speeds.size, 1))
    style: dict[str, Any] = {"histtype": "stepfilled", "color": BLUE, "alpha": 0.85}
    axes.hist(speeds, bins=_SPEED_BINS, weights=weights, **style)
    axes.axvline(median, color=BLACK, linewidth=1.2)
    place = ("data", "axes fraction")
    axes.annotate(f" median {median:.2g}", (median, 1), xycoords=place, va="top", fontsize=10.5)
    axes.grid(axis="y")
    axes.set(xlabel="image speed (px per frame)", ylabel="share of pixels (%)")
    axes.set_xlim(0, None)
    return svg.to_svg(figure, "speed", "Histogram of the true image speed")


def making_section(report: Report) -> Section:
    """Return errors of the rendered light, times and settings."""
    samples = f"Light paths per pixel: {report.settings.render.samples_per_pixel}; four times "
    longest = max(report.timings.values(), default=0.0) or 1.0
    bar = Markup('<span>{}</span><i style="width:{:.1f}%"></i><span>{}</span>')
    bars = (
        bar.format(stage, 100 * spent_s / longest, duration(spent_s))
        for stage, spent_s in report.timings.items()
    )
    variant = ""
    if report.has_truth:
        variant = f"Rendered with Mitsuba’s variant {report.scene.get('variant', 'not noted')}."
    time = f"Time spent: {duration(sum(report.timings.values()))}"
    body = [
        rendering(report.scene, f"{samples}as many halve the noise of a frame."),
        html.definitions("versions", _rendering_errors(report)),
        html.card(time, html.block("bars", *bars), html.paragraph(variant, "note")),
        html.folded("All settings", Markup("<pre>{}</pre>").format(to_yaml(report.settings))),
    ]
    return Section("How it was made", _MADE, body=Markup("\n").join(body), name="made")


def _rendering_errors(report: Report) -> Iterator[tuple[str, str]]:
    """Yield errors of the rendered light, by name."""
    noise = report.scene.get("monte_carlo") or {}
    surface, sky = noise.get("surface") or {}, noise.get("sky") or {}
    errors = {
        "error (RMS) over the mean light": noise.get("median_relative") and noise["rms_over_mean"],
        "the same, of pixels without sky": surface.get("rms"),
        "relative error that 95 % of the pixels do not exceed": surface.get("p95"),
        "share of the gradient energy due to it": surface.get("gradient"),
        "fixed error of baked light (RMS)": surface.get("standing"),
        "share of the gradient energy due to the fixed error": surface.get("standing_gradient"),
        "error of the sky (RMS) over its light": sky.get("rms"),
        "truncation bias of path depth, worst band": max(report.scene.get("light_left_out") or [0]),
    }
    yield from ((name, percent(error)) for name, error in errors.items() if error)


SECTIONS: tuple[Callable[[Report], Section], ...] = (
    light_section,
    motion_section,
    detector_section,
    threshold_section,
    making_section,
)
"""Sections of the page and its navigation, in order."""
