"""Section "What the detectors answer": responses as pictures, errors as tables."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import Image

from megalopta.config.model import Configuration, LightLevel
from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError
from megalopta.dataset.flow_record import FlowRecord, ResponseErrors
from megalopta.dataset.store import Dataset
from megalopta.flow.detectors.base import Detector
from megalopta.flow.detectors.blocks import BlockDetector
from megalopta.flow.detectors.registry import METHODS
from megalopta.flow.files.color_wheel import flow_to_rgb
from megalopta.flow.metrics.endpoint_error import block_flow
from megalopta.plotting.text import (
    UNDEFINED,
    level_name,
    number,
    relative_error,
)
from megalopta.report.components import Picture, Table, crossed, still
from megalopta.report.footage import ReportFrames, Selection
from megalopta.report.images import ColorScale, Legend, map_scale
from megalopta.report.motion import Wheel
from megalopta.report.truth import against_truth, rotation_table, split_table
from megalopta.report.verdicts import VerdictGroup, verdict_group
from megalopta.sensor import ImageSensor, StoredFrames
from megalopta.stages.flow import responses_path

_BRIGHT_PERCENTILE = 99.0
# Bright sky and dark ground answer a thousandfold differently: a root shows both.
_ROOT = 3.0
# Paler on the wheel, a velocity cannot be told from white.
_PALE = 0.02


@dataclass(frozen=True)
class ResponsePair:
    """One method's answers at one light level: to the noise-free twin and to the counts."""

    level: str
    legend: Legend | None
    pictures: tuple[Picture, Picture]


@dataclass(frozen=True)
class SensorResponses:
    """One sensor: the answers of each method, a pair at every light level."""

    name: str
    rows: tuple[tuple[Detector, tuple[ResponsePair, ...]], ...]
    errors: Table


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

    @property
    def kinds(self) -> set[str]:
        """Verdicts that occur."""
        return {each.kind for group in self.verdicts for row in group.rows.values() for each in row}


class _Source(NamedTuple):
    """Whose responses are shown, and how."""

    dataset: Dataset
    selection: Selection
    frame: int
    wheel: Wheel


def detector_section(
    dataset: Dataset, footage: ReportFrames, wheel: Wheel, records: Sequence[FlowRecord]
) -> DetectorSection:
    """Section of a dataset whose flow stage is finished."""
    settings = dataset.configuration
    warm_up = max(record.warm_up_frames for record in records)
    frame = _frame_shown(footage.selection, settings.trajectory.frames, warm_up)
    source = _Source(dataset, footage.selection, frame, wheel)
    return DetectorSection(
        frame=frame,
        truth=_true_blocks(settings.methods, footage, frame, wheel),
        sensors=tuple(_sensor_responses(source, each, records) for each in settings.sensors),
        against_truth=against_truth(records, settings.flow),
        splits=split_table(records),
        rotation=rotation_table(records),
        verdicts=tuple(
            verdict_group(sensor.name, settings.light_levels, records)
            for sensor in settings.sensors
        ),
    )


def _frame_shown(selection: Selection, frames: int, warm_up: int) -> int:
    """The first shown frame in the second half whose responses have settled, or the last shown."""
    wanted = max(frames // 2, warm_up)
    return next((frame for frame in selection.frames if frame >= wanted), selection.frames[-1])


def _true_blocks(
    methods: Sequence[str], footage: ReportFrames, frame: int, wheel: Wheel
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
    source: _Source, sensor: ImageSensor, records: Sequence[FlowRecord]
) -> SensorResponses:
    settings = source.dataset.configuration
    rows = tuple(
        (method, tuple(_pair(source, sensor, level, method) for level in settings.light_levels))
        for method in map(METHODS.__getitem__, settings.methods)
    )
    return SensorResponses(sensor.name, rows, _errors(sensor.name, records))


def _pair(
    source: _Source, sensor: ImageSensor, level: LightLevel, method: Detector
) -> ResponsePair:
    path, name = responses_path(source.dataset, sensor, level), level_name(level)
    shape = _shape(source.dataset.configuration, method)
    answers = [_read(path, f"{method.name}{kind}", source.frame, shape) for kind in ("-ideal", "")]
    if method.gives == "velocity":
        fastest = source.wheel.max_speed
        images = [Image.fromarray(flow_to_rgb(each, fastest)) for each in answers]
        smallest, nothing, legend = _PALE * fastest, "no motion found", None
    else:
        scale = _response_scale(answers[0])
        legend = scale.legend(number(scale.low), number(scale.high))
        images = [scale.picture(source.selection.pixels(each)) for each in answers]
        smallest, nothing = 0.0, "no response"
    notes = ["" if _largest(each) > smallest else nothing for each in answers]
    kinds = "noise-free", f"from {sensor.unit}"
    ideal, noisy = (
        still(image, kind, f"{method.name}, {name}, {kind}", note)
        for image, kind, note in zip(images, kinds, notes, strict=True)
    )
    return ResponsePair(name, legend, (ideal, noisy))


def _read(path: Path, name: str, frame: int, shape: tuple[int, ...]) -> Floats:
    """One frame of an array that must have this shape."""
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
    """Shape of what a method answered."""
    frames, size = settings.trajectory.frames, (settings.camera.height, settings.camera.width)
    if not isinstance(method, BlockDetector):
        return frames, *size
    grid = method.grid(size)
    return frames - 1, grid.rows, grid.columns, 2


def _largest(answer: Floats) -> float:
    """Largest response, or speed, that is defined; 0 where there is none."""
    size = np.abs(answer) if answer.ndim == 2 else np.hypot(answer[..., 0], answer[..., 1])
    return float(np.max(size[np.isfinite(size)], initial=0.0))


def _response_scale(ideal: Floats) -> ColorScale:
    """The scale of a pair, from what the noise-free answer spans."""
    known = ideal[np.isfinite(ideal)]
    high = float(np.percentile(np.abs(known), _BRIGHT_PERCENTILE)) if known.size else 0.0
    high = high or 1.0
    if known.size and known.min() < 0:
        return map_scale("RdBu_r", -high, high, _ROOT)
    return map_scale("inferno", 0.0, high, _ROOT)


def first_sentence(method: Detector) -> str:
    """What a method's docstring says of it first."""
    text = (type(method).__doc__ or "").strip().split("\n")[0].removeprefix(f"{method.name}: ")
    return text[:1].upper() + text[1:]


def _errors(sensor: str, records: Sequence[FlowRecord]) -> Table:
    cells = {
        (each.method, level_name(each.level)): _error_text(each.error)
        for each in records
        if each.sensor == sensor
    }
    return crossed(f"Errors of the responses on {sensor}", "Detector", cells)


def _error_text(errors: ResponseErrors) -> str:
    if errors.ratio is None:
        return UNDEFINED
    return f"{relative_error(errors.ratio)} ({relative_error(errors.literal)})"
