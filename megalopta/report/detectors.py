"""Section "What the detectors answer": responses as pictures, errors as tables."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from PIL import Image

from megalopta.config.model import Configuration, LightLevel
from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError
from megalopta.flow.color_wheel import flow_to_rgb
from megalopta.flow.detectors.base import Detector
from megalopta.flow.detectors.blocks import BlockDetector
from megalopta.flow.detectors.registry import METHODS
from megalopta.flow.metrics.endpoint_error import block_flow
from megalopta.plotting.sections import Section, block, card, heading, image, paragraph
from megalopta.plotting.text import level_name, number
from megalopta.report.error_tables import (
    against_truth,
    cost_table,
    response_table,
    rotation_table,
    split_table,
)
from megalopta.report.images import ColorScale, data_uri, gray_scale, map_scale, still
from megalopta.report.motion_section import mixed_share, wheel
from megalopta.report.remarks import absent, key, rendering
from megalopta.report.source import Report
from megalopta.sensor import ImageSensor, StoredFrames
from megalopta.stages.correction import open_corrected
from megalopta.stages.flow import responses_path
from megalopta.stages.sense import open_exposure

_BRIGHT_PERCENTILE = 99.0
# Bright sky and dark ground answer a thousandfold differently: a root shows both.
_ROOT = 3.0
# Paler on the wheel, a velocity cannot be told from white.
_PALE = 0.02
_GUIDE = (
    "Each detector sees every sequence twice: as counted, and as its noise-free twin, the mean "
    "that would be counted without the randomness of photons. Frame {} is shown in pairs at each "
    "light level: on the left the answer to the noise-free twin, on the right that to its {}, in "
    "the same colors. Where the two look alike, photon noise does no harm."
)
_FLICKER = (
    "This noise is the same in both answers, so it adds no error, but it flickers like texture "
    "that does not move with the scene, and is in the errors against the true motion."
)
_BLOCKS = Markup(
    "<b>The right answer for block methods</b> in this frame: the true motion averaged over their "
    "blocks, in the colors of the wheel (rim: {:.2g} pixels per frame). The other detectors "
    "respond to motion without measuring its speed."
)
_ERRORS = Markup(
    "Readings are brought to a mean of 1 before they are answered; colors spread the cube root of "
    "the answer. Errors compare the answer to counts with that to the noise-free twin, over all "
    "frames after the detectors have settled: <b>ratio</b>, all differences over all answers, and "
    "<b>literal</b> (the thesis's Eq. 4.5), the mean of every single pixel's quotient, which a few "
    "answers near zero carry. From tenfold on an error reads “fails”; a dash says that the "
    "noise-free answer holds no motion."
)
_COSTS = Markup(
    "The same frame as the sensor reads it, corrected where that was asked for (dark counts, dead "
    "time and counter, flat field, hot pixels), and as a perfect sensor would read it on average. "
    "In the tables the ratio error of each detector: <b>against itself</b>, the same device "
    "without noise · <b>raw against perfect</b> · <b>corrected against perfect</b>."
)
_TRUTH = (
    "Block velocities beside the true ones: the mean length of the difference, the share of blocks "
    "that are off by more than 25 % (outliers), and the median; first noise-free, then on {}, then "
    "on corrected readings where there are any. {} of the pixels shown lie on outlines, filled to "
    "less than {:.0%} by what their center sees. {} in everything but the two tables that say "
    "otherwise; blocks of which less than half is left are not scored."
)
_MIXED = {
    "score": "They count like all others",
    "weigh": "Pixels count by their purity",
    "leave_out": "They do not count",
}
_SPLITS = (
    "Blocks by their true speed, in pixels per frame, and by the share of their pixels that is "
    "hidden in the next frame; in brackets the number of blocks, over all frames, on the exposure "
    "where a method errs least."
)
_YAW = (
    "A weighted sum of all local answers, as in a fly’s tangential cells, gives the camera’s yaw "
    "rate. Weights are learned from the noise-free answers to the first half of the sequence; the "
    "root mean square error is that of the second half, first noise-free, then on {}."
)


def detector_section(report: Report) -> Section:
    """Return the section; where detectors have not run, what to run."""
    title = "What the detectors answer"
    section = Section(title, name="detectors", link="Detectors")
    if not report.flow:
        missing = absent(report, "flow", "The motion detectors have not been run yet.")
        return replace(section, body=missing)
    body = Markup("\n").join([*_responses(report), *_costs(report), *_tables(report)])
    text = _GUIDE.format(report.frame + 1, " or ".join(report.units))
    return replace(section, text=text, body=body)


def _responses(report: Report) -> Iterator[Markup]:
    yield rendering(report.scene, _FLICKER)
    yield key(report)
    yield _true_blocks(report)
    for sensor in report.settings.sensors:
        rows = [_row(report, sensor, METHODS[name]) for name in report.settings.methods]
        errors = heading("Error against the noise-free answer: ratio (literal)")
        yield card(sensor.name, *rows, errors, response_table(sensor.name, report.flow))
    yield paragraph(_ERRORS, "note")


def _tables(report: Report) -> Iterator[Markup]:
    settings, units = report.settings.flow, " or ".join(report.units)
    text = _TRUTH.format(units, mixed_share(report), settings.least_purity, _MIXED[settings.mixed])
    for title, guide, found in (
        ("Against the true motion", text, against_truth(report.flow, settings)),
        ("Errors by speed and occlusion", _SPLITS, split_table(report.flow)),
        ("How fast the camera turns", _YAW.format(units), rotation_table(report.flow)),
    ):
        if found:
            yield heading(title) + paragraph(guide) + found


def _true_blocks(report: Report) -> Markup:
    detectors = (METHODS[name] for name in report.settings.methods)
    detector = next((each for each in detectors if isinstance(each, BlockDetector)), None)
    if detector is None:
        return Markup("")
    truth = report.truths[report.selection.frames.index(report.frame)]
    grid = detector.grid(truth.depth.shape)
    flow = block_flow(truth.flow_forward[np.newaxis], grid, truth.occluded_forward[np.newaxis])[0]
    source = data_uri(Image.fromarray(flow_to_rgb(flow, report.fastest)))
    shown = block("blocks", image(source, "True flow averaged over blocks"))
    return wheel(_BLOCKS.format(report.fastest), shown)


def _row(report: Report, sensor: ImageSensor, method: Detector) -> Markup:
    """Return a method's answers at every level, beside what it is."""
    colors = Markup("<br>Colors as on the wheel, white is rest.")
    told = Markup("<b>{}</b> {}<br>{}{}").format(
        method.name,
        method.label,
        first_sentence(method),
        colors if method.gives == "velocity" else "",
    )
    levels = report.settings.light_levels
    pairs = [_pair(report, sensor, level, method) for level in levels]
    width = f"max-width:{260 * len(pairs)}px"
    return block("response", block("", told), block("pairs", *pairs, style=width))


def first_sentence(method: Detector) -> str:
    """Return what a method's docstring says of it first."""
    text = (type(method).__doc__ or "").strip().split("\n")[0].removeprefix(f"{method.name}: ")
    return text[:1].upper() + text[1:]


def _pair(report: Report, sensor: ImageSensor, level: LightLevel, method: Detector) -> Markup:
    """Return the answers to the noise-free twin and to the counts, in the same colors."""
    path, name = responses_path(report.dataset, sensor, level), level_name(level)
    shape = _shape(report.settings, method)
    answers = [_read(path, f"{method.name}{kind}", report.frame, shape) for kind in ("-ideal", "")]
    if method.gives == "velocity":
        images = [Image.fromarray(flow_to_rgb(each, report.fastest)) for each in answers]
        smallest, nothing, legend = _PALE * report.fastest, "no motion found", Markup("")
    else:
        scale = _response_scale(answers[0])
        images = [scale.picture(report.selection.pixels(each)) for each in answers]
        smallest, nothing = 0.0, "no response"
        legend = scale.legend(number(scale.low), number(scale.high))
    kinds = "noise-free", f"from {sensor.unit}"
    shown = [
        still(each, kind, f"{method.name}, {name}, {kind}", "" if size > smallest else nothing)
        for each, kind, size in zip(images, kinds, map(_largest, answers), strict=True)
    ]
    return block("", paragraph(name), block("two", *shown), legend)


def _read(path: Path, name: str, frame: int, shape: tuple[int, ...]) -> Floats:
    """Return one frame of an array that must have this shape."""
    try:
        values: Any = StoredFrames.open(path, name).array
        if values.shape != shape:
            raise ValueError(f"{name} has shape {values.shape}")
        return np.asarray(values[frame], np.float64)
    except (OSError, ValueError, KeyError, TypeError, RuntimeError) as problem:
        raise UserError(
            f"{path} cannot be read ({problem}); run megalopta flow again with --redo"
        ) from None


def _shape(settings: Configuration, method: Detector) -> tuple[int, ...]:
    """Return the shape of what a method answered."""
    frames, size = settings.trajectory.frames, (settings.camera.height, settings.camera.width)
    if not isinstance(method, BlockDetector):
        return frames, *size
    grid = method.grid(size)
    return frames - 1, grid.rows, grid.columns, 2


def _largest(answer: Floats) -> float:
    """Return the largest response, or speed, that is defined; 0 where there is none."""
    size = np.abs(answer) if answer.ndim == 2 else np.hypot(*np.moveaxis(answer, -1, 0))
    return float(np.max(size[np.isfinite(size)], initial=0.0))


def _response_scale(ideal: Floats) -> ColorScale:
    """Return the scale of a pair, from what the noise-free answer spans."""
    known = ideal[np.isfinite(ideal)]
    high = float(np.percentile(np.abs(known), _BRIGHT_PERCENTILE)) if known.size else 0.0
    high = high or 1.0
    if known.size and known.min() < 0:
        return map_scale("RdBu_r", -high, high, _ROOT)
    return map_scale("inferno", 0.0, high, _ROOT)


def _costs(report: Report) -> Iterator[Markup]:
    """Yield what each device costs, where responses were compared with the perfect sensor."""
    tables = {each.name: cost_table(each.name, report.flow) for each in report.settings.sensors}
    if any(tables.values()):
        yield heading("What the device costs") + paragraph(_COSTS)
    for sensor in report.settings.sensors:
        if tables[sensor.name]:
            frames = [_forms(report, sensor, level) for level in report.settings.light_levels]
            yield card(sensor.name, block("strip", *frames), tables[sensor.name])


def _forms(report: Report, sensor: ImageSensor, level: LightLevel) -> Markup:
    """Return the frame that is shown: raw, corrected where that was asked for, perfect."""
    opened, frame = open_exposure(report.dataset, sensor, level), report.frame
    forms = {
        "raw": opened["counts"],
        "corrected": open_corrected(report.dataset, sensor, level),
        "perfect": opened["photons"],
    }
    full = report.selection.pixels(opened["saturated"][[frame]][0])
    shown = []
    for name, frames in forms.items():
        if frames is not None:
            pixels = report.selection.pixels(frames[[frame]][0].astype(np.float64))
            white = max(float(np.percentile(pixels, _BRIGHT_PERCENTILE)), 1e-12)
            drawn = gray_scale(white).picture(pixels, full if name == "raw" else None)
            alt = f"Frame of {sensor.name} at {level_name(level)}, {name}"
            shown.append(still(drawn, name, alt))
    return block("forms", paragraph(level_name(level)), block("pairs", *shown))
