"""Section "Detector responses": responses as pictures, errors as tables.

A method with velocities is also compared with the true motion: a consistently wrong one is
perfectly repeatable. The others give a number without a unit, so the only test is whether their
response to counts equals that to the noise-free readings.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from markupsafe import Markup
from PIL import Image

from megalopta.config.measuring import FlowSettings
from megalopta.config.model import LightLevel
from megalopta.core.arrays import Floats
from megalopta.core.bounded import undamaged
from megalopta.dataset.flow_record import (
    BlockErrors,
    FlowRecord,
    RotationErrors,
    TruthErrors,
)
from megalopta.flow.color_wheel import flow_to_rgb
from megalopta.flow.detectors.base import Detector
from megalopta.flow.detectors.blocks import BlockDetector
from megalopta.flow.detectors.registry import METHODS
from megalopta.flow.metrics.endpoint_error import FAST_PX, OCCLUDED_SHARE, SLOW_PX, block_flow
from megalopta.plotting.sections import Section, block, card, heading, image, paragraph, table
from megalopta.plotting.text import (
    FAILS,
    SENSELESS,
    UNDEFINED,
    level_name,
    number,
    percent,
    relative_error,
)
from megalopta.report.images import ColorScale, data_uri, gray_scale, map_scale, still, wheel
from megalopta.report.motion_section import mixed_share
from megalopta.report.source import Report, absent, key, rendering
from megalopta.sensor import ImageSensor, StoredFrames
from megalopta.stages.correction import open_corrected
from megalopta.stages.flow import responses_path
from megalopta.stages.sense import open_exposure

Value = TypeVar("Value")
Text = TypeVar("Text", bound=str)

ACCURATE = 0.25
"""The dissertation's 2-bit accuracy: an error below 2⁻²."""

_GROUPS = {
    "slow": f"below {SLOW_PX:g} px",
    "medium": f"{SLOW_PX:g} to {FAST_PX:g} px",
    "fast": f"{FAST_PX:g} px or more",
    "clear": f"hidden: below {percent(OCCLUDED_SHARE)}",
    "occlusion": f"hidden: {percent(OCCLUDED_SHARE)} or more",
}


def crossed(label: str, corner: str, cells: Mapping[tuple[Text, str], str]) -> Markup:
    """Return a table of texts by row and column, with a dash for missing cells."""
    rows = dict.fromkeys(row for row, _ in cells)
    columns = dict.fromkeys(column for _, column in cells)
    lines: list[list[str]] = [
        [row, *(cells.get((row, each), UNDEFINED) for each in columns)] for row in rows
    ]
    return table(label, [corner, *columns], lines)


def response_table(sensor: str, records: Sequence[FlowRecord]) -> Markup:
    """Return ratio and literal errors on one sensor, a row per method and a column per level."""
    cells = {
        (each.method, level_name(each.level)): UNDEFINED
        if each.error.ratio is None
        else f"{relative_error(each.error.ratio)} ({relative_error(each.error.literal)})"
        for each in records
        if each.sensor == sensor
    }
    return crossed(f"Errors of the responses on {sensor}", "Detector", cells)


def cost_table(sensor: str, records: Sequence[FlowRecord]) -> Markup:
    """Return a device's ratio errors: against itself, a perfect sensor, and that corrected."""
    cells = {}
    for each in records:
        if each.sensor == sensor and each.error_perfect:
            corrected = [each.error_corrected] if each.error_corrected else []
            ratios = (one.ratio for one in (each.error, each.error_perfect, *corrected))
            cells[each.method, level_name(each.level)] = " · ".join(map(relative_error, ratios))
    label = f"Errors by noise, device and correction on {sensor}"
    return crossed(label, "Detector", cells) if cells else Markup("")


def against_truth(records: Sequence[FlowRecord], settings: FlowSettings) -> Markup:
    """Return errors and shares of outliers, a row per exposure and a column per method.

    The mean error is given with mixed pixels, without them, and as configured.
    """
    truths = {_key(each): each.truth for each in records if each.truth}
    mixtures = {_key(each): each.truth_by_mixture for each in records if each.truth_by_mixture}
    rows = {
        "Mean error (px), all pixels": {key: _error(each.all) for key, each in mixtures.items()},
        f"Mean error (px), without mixed pixels (purity below {percent(settings.least_purity)})": {
            key: _error(each.without_mixed) for key, each in mixtures.items()
        },
    }
    if settings.mixed == "weigh" or not mixtures:
        weighed = "Mean error (px)" + (", pixels weighted by purity" if mixtures else "")
        rows = {weighed: {key: _error(each) for key, each in truths.items()}} | rows
    outliers = "Outliers" + (", without mixed pixels" if settings.mixed == "leave_out" else "")
    rows[outliers] = {
        key: _in_turn([one.outlier_fraction for one in _answers(each)], percent)
        for key, each in truths.items()
    }
    rows["Median relative error"] = {
        key: _in_turn([one.relative_error_median for one in _answers(each)], relative_error)
        for key, each in truths.items()
    }
    return Markup("\n").join(crossed(label, label, cells) for label, cells in rows.items() if cells)


def split_table(records: Sequence[FlowRecord]) -> Markup:
    """Return mean errors by speed and by occlusion, on the exposure with a method's least error."""
    measured = [each for each in records if each.truth_splits]
    if not measured:
        return Markup("")
    best, _ = _key(min(measured, key=lambda each: each.median_error))
    splits = {
        each.method: dict(each.truth_splits)
        for each in measured
        if each.truth_splits and _key(each)[0] == best
    }
    blocks = {name: split.ideal.blocks for name, split in next(iter(splits.values())).items()}
    cells = {
        (method, f"{_GROUPS[name]} ({blocks[name]:,})"): _error(split[name])
        for method, split in splits.items()
        for name in _GROUPS
        if blocks[name]
    }
    label = f"Mean error (px) by speed and occlusion on the best exposure: {best}"
    return crossed(label, "Detector", cells)


def rotation_table(records: Sequence[FlowRecord]) -> Markup:
    """Return errors of the yaw rate, a row per exposure and a column per method."""
    rotations = {_key(each): each.rotation for each in records if each.rotation}
    if not rotations:
        return Markup("")
    true = number(next(iter(rotations.values())).true_deg_s)
    label = f"Error of the yaw rate (deg/s); true RMS {true} deg/s"
    return crossed(label, label, {key: _yaw(each) for key, each in rotations.items()})


def _key(record: FlowRecord) -> tuple[str, str]:
    return f"{record.sensor}, {level_name(record.level)}", record.method


def _yaw(rotation: RotationErrors) -> str:
    largest = SENSELESS * rotation.true_deg_s or math.inf
    errors = (rotation.ideal_deg_s, rotation.counts_deg_s)
    return _in_turn(errors, lambda error: number(error) if error < largest else FAILS)


def _error(truth: TruthErrors) -> str:
    def text(each: BlockErrors) -> str:
        relative, error_px = each.relative_error_median, each.endpoint_error_px
        if error_px is None:
            return UNDEFINED
        return FAILS if relative is not None and relative >= SENSELESS else number(error_px)

    return _in_turn(_answers(truth), text)


def _answers(truth: TruthErrors) -> list[BlockErrors]:
    corrected = [truth.corrected] if truth.corrected else []
    return [truth.ideal, truth.counts, *corrected]


def _in_turn(values: Iterable[Value | None], text: Callable[[Value], str]) -> str:
    """Noise-free → counts → corrected counts."""
    return " → ".join(UNDEFINED if value is None else text(value) for value in values)


_BRIGHT_PERCENTILE = 99.0
# Responses to bright sky and dark ground differ a thousandfold: a root shows both.
_ROOT = 3.0
# Velocities closer to the wheel's center look white.
_PALE = 0.02
_GUIDE = (
    "Each detector runs on every sequence twice: on the readings, and on their noise-free mean. "
    "Frame {} is shown in pairs at each light level: the response to the noise-free reading on "
    "the left, that to its {} on the right, in the same colors. Where the two look alike, photon "
    "noise does no harm."
)
_FLICKER = (
    "This noise is the same in both responses, so it adds no error between them. It flickers like "
    "texture that does not move, and adds to the errors against the true motion."
)
_BLOCKS = Markup(
    "<b>Ground truth for block methods</b> in this frame: the {} averaged over their blocks, in "
    "the colors of the wheel (rim: {:.2g} px per frame). The other detectors respond to motion "
    "without measuring its speed."
)
_ERRORS = Markup(
    "Readings are scaled to a mean of 1; colors show the cube root of the response. Errors compare "
    "the response to counts with that to the noise-free reading, over all frames after the "
    "detectors have settled. <b>Ratio</b>: sum of all differences over sum of all responses. "
    "<b>Literal</b> (the dissertation's Eq. 4.5): mean of each pixel's quotient, dominated by the "
    "few responses near zero. “fails”: an error of ten times or more. A dash: the noise-free "
    "response shows no motion."
)
_COSTS = Markup(
    "The same frame as read by the sensor, corrected if requested (dark counts, dead time and "
    "counter, flat field, hot pixels), and as the mean of a perfect sensor. The tables give the "
    "ratio error of each detector: <b>against itself</b>, the same device without noise · "
    "<b>raw against perfect</b> · <b>corrected against perfect</b>."
)
_TRUTH = (
    "Errors of block velocities: mean endpoint error, share of outliers (blocks with an error over "
    "25 %), and median relative error. An arrow leads from the noise-free value to that on {}, and "
    "to that on corrected readings if there are any. {} of the pixels shown are mixed: the object "
    "at their center fills less than {}. {} except in the two tables that say otherwise. Blocks "
    "with less than half of their pixels left are not scored."
)
_STAND_IN = (
    "The true motion of pictures is unknown. Responses are compared with the flow by DIS between "
    "the pictures without photon noise, which has errors of its own and favors DIS. "
)
_MIXED = {
    "score": "They count like all others",
    "weigh": "Pixels are weighted by purity",
    "leave_out": "They are excluded",
}
_SPLITS = (
    "Errors by the speed of blocks (px per frame) and by the share of their pixels that is hidden "
    "in the next frame, on the exposure with the least error of a method. Brackets hold the number "
    "of blocks in all frames."
)
_YAW = (
    "A weighted sum of all local responses, as in a fly’s tangential cells, gives the camera’s "
    "yaw rate. Weights are learned from the noise-free responses to the first half of the "
    "sequence. The table gives the RMS error on the second half: noise-free → on {}."
)


def detector_section(report: Report) -> Section:
    """Return the section; if detectors have not run, the command to run."""
    title = "Detector responses"
    section = Section(title, name="detectors", link="Detectors")
    if not report.flow:
        missing = absent(report, "flow", "Motion detectors have not run yet.")
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
        errors = heading("Error against the noise-free response: ratio (literal)")
        yield card(sensor.name, *rows, errors, response_table(sensor.name, report.flow))
    yield paragraph(_ERRORS, "note")


def _tables(report: Report) -> Iterator[Markup]:
    settings, units = report.settings.flow, " or ".join(report.units)
    stand_in = "" if report.has_truth else _STAND_IN
    text = stand_in + _TRUTH.format(
        units, mixed_share(report), percent(settings.least_purity), _MIXED[settings.mixed]
    )
    for title, guide, found in (
        (f"Against the {report.motion_name}", text, against_truth(report.flow, settings)),
        ("Errors by speed and occlusion", _SPLITS, split_table(report.flow)),
        ("Yaw rate of the camera", _YAW.format(units), rotation_table(report.flow)),
    ):
        if found:
            yield heading(title) + paragraph(guide) + found


def _true_blocks(report: Report) -> Markup:
    detectors = (METHODS[name] for name in report.settings.methods)
    detector = next((each for each in detectors if isinstance(each, BlockDetector)), None)
    if detector is None:
        return Markup("")
    motion = report.shown.motions[report.frame]
    grid = detector.grid(report.settings.camera.shape)
    flow = block_flow(motion.flow[np.newaxis], grid, motion.hidden[np.newaxis])[0]
    source = data_uri(Image.fromarray(flow_to_rgb(flow, report.fastest)))
    shown = block("blocks", image(source, "Flow averaged over blocks"))
    return wheel(_BLOCKS.format(report.motion_name, report.fastest), shown)


def _row(report: Report, sensor: ImageSensor, method: Detector) -> Markup:
    """Return a method's responses at every level, with its description."""
    colors = Markup("<br>Colors as on the wheel; white: no motion.")
    about = Markup("<b>{}</b> {}<br>{}{}").format(
        method.name,
        method.label,
        first_sentence(method),
        colors if method.gives == "velocity" else "",
    )
    levels = report.settings.light_levels
    pairs = [_pair(report, sensor, level, method) for level in levels]
    width = f"max-width:{260 * len(pairs)}px"
    return block("response", block("", about), block("pairs", *pairs, style=width))


def first_sentence(method: Detector) -> str:
    """Return the first sentence of a method's docstring."""
    text = (type(method).__doc__ or "").strip().split("\n")[0].removeprefix(f"{method.name}: ")
    return text[:1].upper() + text[1:]


def _pair(report: Report, sensor: ImageSensor, level: LightLevel, method: Detector) -> Markup:
    """Return the responses to the noise-free reading and to the counts, in the same colors."""
    path, name = responses_path(report.dataset, sensor, level), level_name(level)
    answers = [_read(path, f"{method.name}{kind}", report.frame) for kind in ("-ideal", "")]
    if method.gives == "velocity":
        images = [Image.fromarray(flow_to_rgb(each, report.fastest)) for each in answers]
        smallest, nothing, legend = _PALE * report.fastest, "no motion found", Markup("")
    else:
        scale = _response_scale(answers[0])
        images = [scale.picture(report.shown.pixels(each)) for each in answers]
        smallest, nothing = 0.0, "no response"
        legend = scale.legend(number(scale.low), number(scale.high))
    kinds = "noise-free", f"from {sensor.unit}"
    shown = [
        still(each, kind, f"{method.name}, {name}, {kind}", "" if size > smallest else nothing)
        for each, kind, size in zip(images, kinds, map(_largest, answers), strict=True)
    ]
    return block("", paragraph(name), block("two", *shown), legend)


def _read(path: Path, name: str, frame: int) -> Floats:
    with undamaged(path, "run megalopta flow again with --redo"):
        return np.asarray(StoredFrames.open(path, name).read([frame])[0], np.float64)


def _largest(answer: Floats) -> float:
    """Return the largest finite response or speed; 0 if there is none."""
    size = np.abs(answer) if answer.ndim == 2 else np.hypot(*np.moveaxis(answer, -1, 0))
    return float(np.max(size[np.isfinite(size)], initial=0.0))


def _response_scale(ideal: Floats) -> ColorScale:
    """Return the color scale of a pair, from the range of the noise-free response."""
    known = ideal[np.isfinite(ideal)]
    high = float(np.percentile(np.abs(known), _BRIGHT_PERCENTILE)) if known.size else 0.0
    high = high or 1.0
    if known.size and known.min() < 0:
        return map_scale("RdBu_r", -high, high, _ROOT)
    return map_scale("inferno", 0.0, high, _ROOT)


def _costs(report: Report) -> Iterator[Markup]:
    """Yield the cost of each device, if responses were compared with the perfect sensor."""
    tables = {each.name: cost_table(each.name, report.flow) for each in report.settings.sensors}
    if any(tables.values()):
        yield heading("Loss by the device") + paragraph(_COSTS)
    for sensor in report.settings.sensors:
        if tables[sensor.name]:
            frames = [_forms(report, sensor, level) for level in report.settings.light_levels]
            yield card(sensor.name, block("strip", *frames), tables[sensor.name])


def _forms(report: Report, sensor: ImageSensor, level: LightLevel) -> Markup:
    """Return the frame shown: raw, corrected if requested, perfect."""
    opened, frame = open_exposure(report.dataset, sensor, level), report.frame
    forms = {
        "raw": opened["counts"],
        "corrected": open_corrected(report.dataset, sensor, level),
        "perfect": opened["photons"],
    }
    full = report.shown.pixels(opened["saturated"][[frame]][0])
    shown = []
    for name, frames in forms.items():
        if frames is not None:
            pixels = report.shown.pixels(frames[[frame]][0].astype(np.float64))
            white = max(float(np.percentile(pixels, _BRIGHT_PERCENTILE)), 1e-12)
            drawn = gray_scale(white).picture(pixels, full if name == "raw" else None)
            alt = f"Frame of {sensor.name} at {level_name(level)}, {name}"
            shown.append(still(drawn, name, alt))
    return block("forms", paragraph(level_name(level)), block("pairs", *shown))
