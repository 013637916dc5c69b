"""Section "What the device costs": readings raw, corrected and of a perfect sensor."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from megalopta.config.model import LightLevel
from megalopta.core.arrays import Floats
from megalopta.dataset.flow_record import FlowRecord, ResponseErrors
from megalopta.dataset.store import Dataset
from megalopta.plotting.text import UNDEFINED, level_name, relative_error
from megalopta.report.components import Picture, Table, crossed, still
from megalopta.report.footage import Selection
from megalopta.report.images import gray_scale
from megalopta.sensor import ImageSensor
from megalopta.stages.correction import open_corrected
from megalopta.stages.sense import open_exposure

_WHITE_PERCENTILE = 99.0


@dataclass(frozen=True)
class DeviceCost:
    """One sensor: a frame at every level in three forms, and the errors of each detector."""

    sensor: str
    pictures: tuple[tuple[str, tuple[Picture, ...]], ...]
    """By light level: raw, corrected where that was asked for, perfect"""
    errors: Table | None
    """None where responses were not compared with the perfect sensor"""
    is_corrected: bool


def device_costs(
    dataset: Dataset, selection: Selection, frame: int, records: Sequence[FlowRecord]
) -> tuple[DeviceCost, ...]:
    """Return what each sensor costs, with pictures of one frame."""
    levels = dataset.configuration.light_levels
    return tuple(
        DeviceCost(
            sensor.name,
            tuple(
                (level_name(level), _pictures(dataset, sensor, level, selection, frame))
                for level in levels
            ),
            _table(sensor.name, records),
            open_corrected(dataset, sensor, levels[0]) is not None,
        )
        for sensor in dataset.configuration.sensors
    )


def _pictures(
    dataset: Dataset, sensor: ImageSensor, level: LightLevel, selection: Selection, frame: int
) -> tuple[Picture, ...]:
    opened = open_exposure(dataset, sensor, level)
    corrected = open_corrected(dataset, sensor, level)
    forms = {
        "raw": opened["counts"],
        "corrected": corrected,
        "perfect": opened["photons"],
    }
    full = selection.pixels(opened["saturated"][[frame]][0])
    unmarked = np.zeros_like(full)
    pictures = []
    for name, frames in forms.items():
        if frames is not None:
            image: Floats = selection.pixels(frames[[frame]][0].astype(np.float64))
            white = max(float(np.percentile(image, _WHITE_PERCENTILE)), 1e-12)
            drawn = gray_scale(white).picture(image, full if name == "raw" else unmarked)
            alt = f"Frame of {sensor.name} at {level_name(level)}, {name}"
            pictures.append(still(drawn, name, alt))
    return tuple(pictures)


def _table(sensor: str, records: Sequence[FlowRecord]) -> Table | None:
    cells = {
        (each.method, level_name(each.level)): _cell(each)
        for each in records
        if each.sensor == sensor and each.error_perfect
    }
    return (
        crossed(f"Noise, device and correction on {sensor}", "Detector", cells) if cells else None
    )


def _cell(record: FlowRecord) -> str:
    errors = [record.error, record.error_perfect]
    errors += [record.error_corrected] if record.error_corrected else []
    return " · ".join(map(_ratio, errors))


def _ratio(errors: ResponseErrors | None) -> str:
    return UNDEFINED if errors is None or errors.ratio is None else relative_error(errors.ratio)
