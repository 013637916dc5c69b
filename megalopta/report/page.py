"""The report of a dataset: results, light, motion, detectors, and how it was made."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from markupsafe import Markup

from megalopta import __version__
from megalopta.config.model import LightLevel
from megalopta.config.yaml_model import to_yaml
from megalopta.core.progress import duration, step
from megalopta.dataset.store import Dataset
from megalopta.report import images, sections as html
from megalopta.report.detectors import (
    ACCURATE,
    STAND_IN,
    absent,
    detector_section,
    threshold_section,
)
from megalopta.report.sections import Section
from megalopta.report.source import Budget, Report
from megalopta.report.text import (
    level_name,
    level_title,
    number,
    percent,
    title,
    with_error,
)
from megalopta.scenes import Pictures
from megalopta.scenes.levels import illuminance_of

_LIGHT = (
    "Each sensor is exposed to the same light, scaled to each level; a named level has its own "
    "spectrum. Orange pixels are saturated: their readings are lower bounds. "
)
_COLUMNS = Markup(
    "Means over pixels and frames, per pixel and exposure. <b>Detected</b>: photons that release a "
    "pulse or an electron. <b>Dark</b>: readings without light. <b>Expected</b>: noise-free mean "
    "after dead time. <b>Signal-to-noise</b> (median over pixels): the light's contribution to a "
    "reading over the reading's standard deviation. <b>Rendering : shot noise</b>: ratio of "
    "standard deviations; above 1, the rendering is noisier than the photons."
)


@step("drawing the report")
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
        [
            light_section(report),
            motion_section(report),
            detector_section(report),
            threshold_section(report),
            making_section(report),
        ],
        header=_opening(report),
        player=report.player(),
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


class _Reached(NamedTuple):
    """Errors of a method at one light level, against the reference motion; the best is least."""

    is_wrong: bool
    """True if the median error is above 25 %"""
    illuminance_lux: float
    """0 if it is wrong"""
    error: float
    """Median over the blocks, relative"""
    outliers: float
    """Share of blocks that are off by more than 25 %"""
    sensor: str
    method: str
    """Name, with ", corrected" on corrected readings"""
    level: LightLevel


def _opening(report: Report) -> Markup:
    """Return how far down in light motion is found, or the least error, and on which sensor."""
    if not report.exposures:
        return Markup("")
    reached: dict[str, list[_Reached]] = {}
    for record in report.flow:
        if (truth := record.truth) is None:
            continue
        for ending, errors in (("", truth.counts), (", corrected", truth.corrected)):
            if errors and (median := errors.relative_error_median) is not None:
                is_wrong = median >= ACCURATE
                lux = 0.0 if is_wrong else illuminance_of(record.level)
                where = record.sensor, f"{record.method}{ending}", record.level
                result = _Reached(is_wrong, lux, median, errors.outlier_fraction or 0.0, *where)
                reached.setdefault(record.sensor, []).append(result)
    best = [min(results, key=lambda result: result[:3]) for results in reached.values()]
    sensor, sentence, rows = report.settings.sensors[0].name, "", []
    if report.flow:
        sentence = f"No method stays within 25 % of the {report.motion_name} at any level."
    if best and not (first := min(best, key=lambda result: result[:3])).is_wrong:
        sensor = first.sensor
        sentence = (
            f"{first.method} on {sensor} stays within 25 % of the {report.motion_name} down to "
            f"{level_title(first.level)}: the median error of its blocks is "
            f"{percent(first.error)}, and {percent(first.outliers)} of them are off by more "
            "than 25 %."
        )
    head = ("sensor", "best method", "within 25 % down to", "median error there")
    for result in best:
        level, error = level_name(result.level), percent(result.error)
        reach = ("none", f"{error} at {level}") if result.is_wrong else (level, error)
        rows.append((result.sensor, result.method, *reach))
    shown, frames, budgets = report.shown, report.shown.frames, report.of(sensor)
    bright_first = images.evenly_spaced(budgets, 4)
    films = [_counts_film(report, budget) for budget in bright_first]
    if flow := shown.found_flow(budgets[0].sensor, budgets[0].level):
        films.append(flow.film(frames, f"{flow.name} at {flow.level}"))
    if shown.rim:
        films.append(shown.motion(report.motion_name).film(frames))
    return html.block(
        "outcome",
        Markup("<h2>Results</h2>"),
        html.paragraph(sentence),
        html.block("strip", *films),
        html.table("Results", head, rows) if rows else Markup(""),
        html.paragraph("" if report.has_truth or not report.flow else STAND_IN, "note"),
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
    )
    if not report.exposures:
        missing = absent(report, "sense", "No sensor has been exposed yet.")
        return replace(section, body=missing)
    shutter, body, rows = report.settings.shutter, [], []
    if not report.has_truth:
        timing = "The light of a picture is constant during an exposure, but for sub_frames."
    elif shutter.is_instant:
        timing = "Every frame is rendered at one instant, without motion blur."
    else:
        timing = (
            "Frames and true motion are those of the shutter, blurred by the motion during "
            f"{shutter.exposure_s or 0:g} s and read out from the {shutter.readout_from} within "
            f"{shutter.readout_s or 0:g} s."
        )
    for sensor in report.settings.sensors:
        budgets = report.of(sensor.name)
        films = (_counts_film(report, budget) for budget in budgets)
        exposure = html.paragraph(f"Exposure: {with_error(sensor.exposure_s, 0, 's')}.", "note")
        parts = html.heading(sensor.name), exposure, html.block("strip", *films)
        body.append(html.block("card", *parts))
        for budget in budgets:
            cells = map(number, (budget.photons, budget.detected, budget.dark, budget.expected))
            saturated = percent(budget.saturated_fraction)
            noise = number(budget.signal_to_noise), saturated, number(budget.rendering_noise)
            rows.append((f"{sensor.name}, {level_title(budget.level)}", *cells, *noise))
    if light := report.scene.get("illuminance"):
        timing += f" As rendered, the illuminance in the open is {light['unshaded_lux']:.3g} lux"
        if ground := [point["lux"] for point in light["ground"]]:
            timing += f", and {sum(ground) / len(ground):.2g} lux on the ground below the camera"
        timing += "."
    unit = " or ".join(report.units)
    head = (
        *("Sensor and light", "Photons on the pixel", "Detected", f"Dark {unit}"),
        *(f"Expected {unit}", "Signal-to-noise", "Saturated", "Rendering : shot noise"),
    )
    body += [html.table("Photon budget", head, rows), html.paragraph(_COLUMNS, "note")]
    return replace(section, text=_LIGHT + timing, body=Markup("\n").join(body))


def motion_section(report: Report) -> Section:
    """Return the section "True motion"; for pictures, with the stand-in for it."""
    shown, truths = report.shown, report.truths
    films, speed = [], 0.0
    if shown.rim:
        films.append(shown.motion(report.motion_name).film(shown.frames))
        flow = np.concatenate([shown.motion_of(frame).reshape(-1, 2) for frame in shown.frames])
        known = np.hypot(*flow[np.isfinite(flow).all(axis=-1)].T)
        speed = float(np.median(known)) if known.size else 0.0
    if not report.has_truth:
        body = html.block("strip", *films) + (images.wheel(shown.rim) if shown.rim else "")
        text = f"{STAND_IN}Its median speed is {speed:.2g} px per frame."
        return Section("Motion of the pictures", text, body=body, name="motion")
    films.append(shown.depth.film(shown.frames))
    if shown.rim:
        hidden = []
        for frame, truth in zip(shown.frames, truths, strict=True):
            gray = np.asarray(shown.light.picture(frame).convert("L")) * 0.35
            picture = np.repeat(gray[..., np.newaxis], 3, axis=-1).astype(np.uint8)
            picture[shown.pixels(truth.occluded_forward)] = images.ORANGE
            hidden.append(images.rgb_picture(picture))
        alt = "Occluded pixels in orange"
        films.append(images.film(hidden, "occluded in the next frame", alt))
    body = html.block("strip", *films)
    if not shown.rim:
        text = "A single frame has no motion; its depth is known exactly."
        return Section("Truth", text, body=body, name="motion")
    note = (
        f"Depth is measured {report.settings.camera.depth_meaning}; its colors are logarithmic. "
        "Orange pixels are occluded in the next frame."
    )
    body += images.wheel(shown.rim) + html.paragraph(note, "note")
    share = percent(float(np.mean([truth.occluded_forward.mean() for truth in truths])))
    text = f"The median speed is {speed:.2g} px per frame; {share} of the pixels are hidden next."
    return Section("True motion", text, body=body, name="motion")


def making_section(report: Report) -> Section:
    """Return the noise of the rendered light (median over pixels), times and settings."""
    times = report.timings.items()
    spent = ", ".join(f"{stage} {duration(seconds)}" for stage, seconds in times)
    body = [html.paragraph(f"Time spent: {spent}.", "note")]
    noise = report.scene.get("monte_carlo") or {}
    if relative := noise.get("median_relative"):
        is_noisy = relative > 0.1
        text = (
            f"{'Caution: noisy rendering. ' * is_noisy}The rendering is as noisy as "
            f"{number(noise['equivalent_photons_per_pixel'])} photons per pixel "
            f"({percent(relative)} of its light). It adds to the errors against the true motion. "
            f"Light paths per pixel: {report.settings.render.samples_per_pixel}; four times as "
            "many halve the noise of a frame."
        )
        body.insert(0, html.paragraph(text, "warn" if is_noisy else "note"))
    if report.has_truth:
        variant = report.scene.get("variant", "not noted")
        body.append(html.paragraph(f"Rendered with Mitsuba’s variant {variant}.", "note"))
    folded = Markup("<details><summary>All settings</summary>\n<pre>{}</pre></details>")
    body.append(folded.format(to_yaml(report.settings)))
    text = "The settings, with their seeds, reproduce this page, but for the noise of rendering."
    return Section("How it was made", text, body=Markup("\n").join(body), name="made")
