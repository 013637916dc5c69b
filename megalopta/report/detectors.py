"""Section "What the detectors answer": responses as pictures, errors as tables."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from PIL import Image

from megalopta.configuration import LightLevel
from megalopta.dataset import Dataset
from megalopta.errors import UserError
from megalopta.flow.block_detector import BlockDetector
from megalopta.flow.color_wheel import flow_to_rgb
from megalopta.flow.detector import Detector
from megalopta.flow.methods import METHODS
from megalopta.flow.truth_error import block_flow
from megalopta.report.footage import Footage, Selection
from megalopta.report.images import ColorScale, Legend, map_scale
from megalopta.report.motion import Wheel
from megalopta.report.parts import Picture, Table, still
from megalopta.report.text import UNDEFINED, level_name, number, relative_error
from megalopta.report.truth import against_truth, rotation_table, split_table
from megalopta.scenes.light import illuminance_of
from megalopta.sensor import ImageSensor
from megalopta.stage_flow import responses_path

ACCURATE = 0.25
"""The thesis's 2-bit accuracy: an error below 2⁻²."""

Floats = NDArray[np.floating]
Record = Mapping[str, Any]

_BRIGHT_PERCENTILE = 99.0
# Bright sky and dark ground answer a thousandfold differently: a root shows both.
_ROOT = 3.0


@dataclass(frozen=True)
class ResponseRow:
    """One method's answers: noise-free first, then to the counts at every light level."""

    method: str
    label: str
    description: str
    legend: Legend | None
    pictures: tuple[Picture, ...]


@dataclass(frozen=True)
class SensorResponses:
    """All methods on one sensor."""

    name: str
    rows: tuple[ResponseRow, ...]
    errors: Table


@dataclass(frozen=True)
class Verdict:
    """Whether a method reads motion: "both" metrics, "ratio" alone, "neither", "undefined"."""

    kind: str
    title: str


@dataclass(frozen=True)
class VerdictGroup:
    """A sensor's verdicts: its light levels, and one row of verdicts per method."""

    sensor: str
    levels: tuple[str, ...]
    rows: Mapping[str, tuple[Verdict, ...]]


@dataclass(frozen=True)
class DetectorSection:
    """Pictures of one frame, errors of all."""

    frame: int
    truth: Picture | None
    sensors: tuple[SensorResponses, ...]
    against_truth: tuple[Table, ...]
    splits: Table | None
    rotation: Table | None
    verdicts: tuple[VerdictGroup, ...]


def read_records(dataset: Dataset) -> list[Record]:
    """Errors of every method on every sensor at every light level, from flow.json."""
    path = dataset.result("flow.json")
    try:
        return list(json.loads(path.read_text("utf-8")))
    except (OSError, ValueError) as problem:
        raise UserError(f"{path}: {problem}; run megalopta flow again with --redo") from None


def detector_section(
    dataset: Dataset, footage: Footage, wheel: Wheel, records: Sequence[Record]
) -> DetectorSection:
    """Section of a dataset whose flow stage is finished."""
    settings = dataset.configuration
    warm_up = max(record["warm_up_frames"] for record in records)
    frame = _frame_shown(footage.selection, settings.trajectory.frames, warm_up)
    return DetectorSection(
        frame=frame,
        truth=_true_blocks(settings.methods, footage, frame, wheel),
        sensors=tuple(
            _sensor_responses(dataset, sensor, frame, footage.selection, wheel, records)
            for sensor in settings.sensors
        ),
        against_truth=against_truth(records),
        splits=split_table(records),
        rotation=rotation_table(records),
        verdicts=tuple(
            _verdicts(sensor.name, settings.light_levels, records) for sensor in settings.sensors
        ),
    )


def _frame_shown(selection: Selection, frames: int, warm_up: int) -> int:
    """The first shown frame in the second half whose responses have settled, or the last shown."""
    wanted = max(frames // 2, warm_up)
    return next((frame for frame in selection.frames if frame >= wanted), selection.frames[-1])


def _true_blocks(
    methods: Sequence[str], footage: Footage, frame: int, wheel: Wheel
) -> Picture | None:
    detectors = (METHODS[name] for name in methods)
    detector = next((each for each in detectors if isinstance(each, BlockDetector)), None)
    if detector is None:
        return None
    truth = footage.truths[footage.selection.frames.index(frame)]
    grid = detector.grid(truth.depth.shape)
    flow = block_flow(truth.flow_forward[np.newaxis], grid, truth.occluded_forward[np.newaxis])[0]
    image = Image.fromarray(flow_to_rgb(flow, wheel.max_speed))
    return still(image, "true motion per block", "True flow averaged over blocks")


def _sensor_responses(
    dataset: Dataset,
    sensor: ImageSensor,
    frame: int,
    selection: Selection,
    wheel: Wheel,
    records: Sequence[Record],
) -> SensorResponses:
    settings = dataset.configuration
    levels = settings.light_levels
    stores = [_open(dataset, sensor, level) for level in levels]
    brightest = stores[int(np.argmax([illuminance_of(level) for level in levels]))]
    rows = []
    for name in settings.methods:
        ideal = np.asarray(brightest[f"{name}-ideal"][frame])
        noisy = [np.asarray(store[name][frame]) for store in stores]
        rows.append(_row(METHODS[name], ideal, noisy, levels, selection, wheel))
    return SensorResponses(
        sensor.name, tuple(rows), _error_table(sensor.name, settings.methods, levels, records)
    )


def _open(dataset: Dataset, sensor: ImageSensor, level: LightLevel) -> Any:
    path = responses_path(dataset, sensor, level)
    try:
        return zarr.open_group(path, mode="r")
    except (OSError, ValueError) as problem:
        raise UserError(f"{path}: {problem}; run megalopta flow again with --redo") from None


def _row(
    method: Detector,
    ideal: Floats,
    noisy: Sequence[Floats],
    levels: Sequence[LightLevel],
    selection: Selection,
    wheel: Wheel,
) -> ResponseRow:
    titles = ["noise-free", *(level_name(level) for level in levels)]
    if method.gives == "velocity":
        legend = None
        images = [Image.fromarray(flow_to_rgb(each, wheel.max_speed)) for each in (ideal, *noisy)]
    else:
        scale = _response_scale(ideal)
        legend = scale.legend(number(scale.low), number(scale.high))
        images = [scale.picture(selection.pixels(each)) for each in (ideal, *noisy)]
    return ResponseRow(
        method.name,
        method.label,
        _first_sentence(method),
        legend,
        tuple(
            still(image, title, f"{method.name}, {title}")
            for image, title in zip(images, titles, strict=True)
        ),
    )


def _response_scale(ideal: Floats) -> ColorScale:
    """One scale for all light levels, from what the noise-free answer spans."""
    known = ideal[np.isfinite(ideal)]
    high = float(np.percentile(np.abs(known), _BRIGHT_PERCENTILE)) if known.size else 0.0
    high = high or 1.0
    signed = known.size and known.min() < 0
    if signed:
        return map_scale("RdBu_r", -high, high, _ROOT)
    return map_scale("inferno", 0.0, high, _ROOT)


def _first_sentence(method: Detector) -> str:
    text = (type(method).__doc__ or "").strip().split("\n")[0]
    text = text.removeprefix(f"{method.name}: ")
    return text[:1].upper() + text[1:]


def _error_table(
    sensor: str, methods: Sequence[str], levels: Sequence[LightLevel], records: Sequence[Record]
) -> Table:
    rows = tuple(
        (method, *(_error_text(_find(records, sensor, level, method)["error"]) for level in levels))
        for method in methods
    )
    return Table(
        f"Errors of the responses on {sensor}",
        ("Detector", *(level_name(level) for level in levels)),
        rows,
    )


def _error_text(errors: Mapping[str, float | None]) -> str:
    if errors["ratio"] is None:
        return UNDEFINED
    return f"{relative_error(errors['ratio'])} ({relative_error(errors['literal'])})"


def _find(records: Sequence[Record], sensor: str, level: LightLevel, method: str) -> Record:
    key = (sensor, level, method)
    return next(each for each in records if (each["sensor"], each["level"], each["method"]) == key)


def _verdicts(sensor: str, levels: Sequence[LightLevel], records: Sequence[Record]) -> VerdictGroup:
    methods = dict.fromkeys(each["method"] for each in records)
    return VerdictGroup(
        sensor,
        tuple(level_name(level) for level in levels),
        {
            method: tuple(
                _verdict(_find(records, sensor, level, method)["error"]) for level in levels
            )
            for method in methods
        },
    )


def _verdict(errors: Mapping[str, float | None]) -> Verdict:
    ratio, literal = errors["ratio"], errors["literal"]
    if ratio is None or literal is None:
        return Verdict("undefined", "no motion in any scored frame of the noise-free answer")
    accurate = (ratio < ACCURATE, literal < ACCURATE)
    kind = {(True, True): "both", (True, False): "ratio", (False, True): "literal"}
    text = f"ratio {relative_error(ratio)}, literal {relative_error(literal)}"
    return Verdict(kind.get(accurate, "neither"), text)
