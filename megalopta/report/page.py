"""The report of a dataset: results, light, motion, detectors, and how it was made."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from markupsafe import Markup

from megalopta import __version__
from megalopta.core.progress import duration, step
from megalopta.core.quantities import number, percent, with_error
from megalopta.dataset.flow_record import FlowRecord
from megalopta.dataset.store import Dataset
from megalopta.flow.detectors.registry import METHODS
from megalopta.report import detectors, images, sections as html
from megalopta.report.source import Budget, Report
from megalopta.report.text import level_name, level_title, lux, title
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
    shown, frames, best = report.shown, report.settings.trajectory.frames, best_flow(report)
    pixels = f"one of {shown.step} × {shown.step} pixels and " if shown.step > 1 else ""
    return html.write_sections(
        dataset.root / "report.html",
        title(report.settings),
        outcome(report, best),
        [
            detectors.detector_section(report),
            light_section(report),
            motion_section(report),
            detectors.threshold_section(report),
            making_section(report),
        ],
        header=first_screen(report, best),
        player=report.player(),
        footer=(
            f"Written by megalopta {__version__}. Pictures show {pixels}{len(shown.frames)} of "
            f"{frames} frames; the last one has no next frame, so no motion."
        ),
    )


def best_flow(report: Report) -> FlowRecord | None:
    """Return the flow that is accurate in the dimmest light, or nearest to it; None if none."""

    def badness(record: FlowRecord) -> tuple[bool, float, float]:
        is_wrong = not is_accurate(record)
        return is_wrong, 0.0 if is_wrong else illuminance_of(record.level), record.median_error

    known = [record for record in report.flow if math.isfinite(record.median_error)]
    return min(known, key=badness, default=None)


def is_accurate(record: FlowRecord) -> bool:
    """Return whether three quarters of the blocks or more are within 25 %."""
    outliers = record.truth.counts.outlier_fraction if record.truth else None
    return outliers is not None and outliers <= detectors.ACCURATE


def outcome(report: Report, best: FlowRecord | None) -> str:
    """Return one sentence: what was measured, and whether it is good."""
    if not report.exposures:
        return "The light and its exact motion are rendered; no sensor has been exposed to it yet."
    if best is None:
        names = " and ".join(pixels_of(sensor.name) for sensor in report.settings.sensors)
        return f"The light has become {' and '.join(report.units)} of {names}; no motion is scored."
    (lit,) = (budget for budget in report.of(best.sensor) if budget.level == best.level)
    light = f"{number(lit.detected)} detected photons per pixel and frame"
    where = f"{level_title(best.level)}, {light}"
    if not is_accurate(best):
        return (
            f"No method finds the {report.motion_name} in this light: "
            f"{in_words(best)} on {pixels_of(best.sensor)} comes nearest, at {where}."
        )
    dimmest = min(map(illuminance_of, report.settings.light_levels))
    is_dimmest = illuminance_of(best.level) == dimmest
    below = "the dimmest light tried" if is_dimmest else "in dimmer light every method fails"
    unit = {sensor.name: sensor.unit for sensor in report.settings.sensors}[best.sensor]
    return (
        f"{in_words(best)} finds the {report.motion_name} in the {unit} of "
        f"{pixels_of(best.sensor)} down to {where}; {below}."
    )


def pixels_of(sensor: str) -> str:
    """Return a sensor by its name; the one without flaws, which is no device, as its pixels."""
    return "ideal pixels" if sensor == "ideal" else sensor


def in_words(record: FlowRecord) -> str:
    """Return the method of a record by its full and its short name."""
    return f"{METHODS[record.method].label} ({record.method})"


def first_screen(report: Report, best: FlowRecord | None) -> Markup:
    """Return one film, from light to flow and truth, and one number with its meaning."""
    shown, films = report.shown, [report.shown.light.film(report.shown.frames)]
    if report.exposures:
        budgets = report.of(best.sensor if best else report.settings.sensors[0].name)
        levels = [budget.level for budget in images.evenly_spaced(budgets, 3)]
        if best and best.level not in levels:
            levels[1] = best.level
        films += [_counts_film(report, budget) for budget in budgets if budget.level in levels]
    if best:
        flow = shown.dense_flow(best)
        films.append(flow.film(shown.frames, f"{flow.name}, {flow.level}"))
    if shown.rim:
        films.append(shown.motion(report.motion_name).film(shown.frames))
    parts = []
    if best and (truth := best.truth):
        score = Markup("<b>{}</b>").format(percent(best.median_error))
        low, high = map(percent, truth.counts.relative_error_interval)
        meaning = (
            f"of the speed is the median error of flow at {level_name(best.level)} (95 %: {low} to "
            f"{high}). {percent(truth.counts.outlier_fraction)} of blocks err by over 25 %; "
            "below a quarter is good. "
            f"{'' if report.has_truth else detectors.STAND_IN}"
        )
        parts.append(html.block("score", score, html.paragraph(meaning)))
    parts.append(html.block("strip", *films))
    if shown.rim:
        parts.append(images.wheel(shown.rim))
    return html.block("outcome", *parts)


def _counts_film(report: Report, budget: Budget) -> Markup:
    """Return the readings of an exposure as a film, with their scale."""
    panel = report.shown.readings(budget.sensor, budget.level)
    return panel.film(report.shown.frames, f"{panel.name} of {panel.sensor}, {panel.level}")


def scene_and_light(report: Report) -> str:
    """Return sentences on scene, camera, and the light before it was scaled."""
    settings, scene = report.settings, report.settings.scene
    if isinstance(scene, Pictures):
        pictures = report.scene["pictures"]
        return (
            f"{scene.describe()} {pictures['transfer']} codes are converted to light; white has "
            f"the spectrum of {scene.white_name(settings.light)}, and the mean reflectance is "
            f"{percent(scene.reflectance)}. {percent(pictures['saturated'])} of the pixels are "
            "saturated in the file."
        )
    before = f"{len(settings.objects)} objects are added. " if settings.objects else ""
    return f"{scene.describe()} {before}The {settings.camera} {settings.trajectory}."


def light_section(report: Report) -> html.Section:
    """Return the section "From light to counts"; without counts, the command to run."""
    section = html.Section(f"From light to {' and '.join(report.units)}", name="light")
    if not report.exposures:
        missing = detectors.absent(report, "sense", "No sensor has been exposed yet.")
        return replace(section, body=missing)
    shutter, films_of_all, rows = report.settings.shutter, [], []
    if not report.has_truth:
        timing = "The light of a picture is constant during an exposure, but for sub_frames."
    elif shutter.is_instant:
        timing = "Frames are rendered at one instant, without blur."
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
        films_of_all.append(html.block("card", *parts))
        for budget in budgets:
            cells = map(number, (budget.photons, budget.detected, budget.dark, budget.expected))
            saturated = percent(budget.saturated_fraction)
            noise = number(budget.signal_to_noise), saturated, number(budget.rendering_noise)
            rows.append((f"{sensor.name}, {level_title(budget.level)}", *cells, *noise))
    if light := report.scene.get("illuminance"):
        rendered = light["unshaded_lux"]
        divided = (
            f"by {number(rendered / illuminance_of(level))} for {level_name(level)}"
            for level in report.settings.light_levels
        )
        timing += f" The rendered light, {lux(rendered)} in the open"
        if ground := [point["lux"] for point in light["ground"]]:
            timing += f" and {sum(ground) / len(ground):.2g} lux on the ground below the camera"
        timing += f", is divided {', '.join(divided)}."
    unit = " or ".join(report.units)
    head = (
        *("Sensor and light", "Photons on the pixel", "Detected", f"Dark {unit}"),
        *(f"Expected {unit}", "Signal-to-noise", "Saturated", "Rendering : shot noise"),
    )
    body = [
        html.folded("Every sensor at every level", *films_of_all),
        html.folded(
            "Photon budget",
            html.table("Photon budget", head, rows),
            html.paragraph(_COLUMNS, "note"),
        ),
    ]
    return replace(section, text=_LIGHT + timing, body=Markup("\n").join(body))


def motion_section(report: Report) -> html.Section:
    """Return the section "True motion"; for pictures, with the stand-in for it."""
    shown, truths = report.shown, report.truths
    films, speed = [], 0.0
    if shown.rim:
        films.append(shown.motion(report.motion_name).film(shown.frames))
        flow = np.concatenate([shown.motion_of(frame).reshape(-1, 2) for frame in shown.frames])
        known = np.hypot(*flow[np.isfinite(flow).all(axis=-1)].T)
        speed = float(np.median(known)) if known.size else 0.0
    if not report.has_truth:
        body = html.block("strip", *films)
        text = f"{detectors.STAND_IN}Its median speed is {speed:.2g} px per frame."
        return html.Section("Motion of the pictures", text, body=body, name="motion")
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
        return html.Section("Truth", text, body=body, name="motion")
    note = f"Depth is measured {report.settings.camera.depth_meaning}; its colors are logarithmic."
    body += html.paragraph(note, "note")
    share = percent(float(np.mean([truth.occluded_forward.mean() for truth in truths])))
    text = f"The median speed is {speed:.2g} px per frame; {share} of the pixels are hidden next."
    return html.Section("True motion", text, body=body, name="motion")


def making_section(report: Report) -> html.Section:
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
            f"({percent(relative)} of its light). "
            f"Light paths per pixel: {report.settings.render.samples_per_pixel}."
        )
        body.insert(0, html.paragraph(text, "warn" if is_noisy else "note"))
    if report.has_truth:
        variant = report.scene.get("variant", "not noted")
        body.append(html.paragraph(f"Rendered with Mitsuba’s variant {variant}.", "note"))
    text = f"{scene_and_light(report)} All settings, with their seeds, are in dataset.yaml."
    return html.Section("How it was made", text, body=Markup("\n").join(body), name="made")
