"""Corrected frames: corrected/SEQ/SENSOR-LEVEL.zarr, with the arrays of `Corrected`."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import zarr

from megalopta.config.model import LightLevel
from megalopta.core import files
from megalopta.core.bounded import undamaged
from megalopta.core.errors import refused_as, shell_command
from megalopta.core.progress import progress
from megalopta.dataset.frames import frames_at_once, write_frames
from megalopta.dataset.store import Dataset, exposure_name
from megalopta.sensor import ImageSensor, OpenedCounts, Sensor, StoredFrames
from megalopta.sensor.calibrate.correction import correct, simulated_calibration
from megalopta.sensor.expectations import settled
from megalopta.sensor.formats.counts_store import format_attribute
from megalopta.sensor.frame.model import FrameSensor

_UNITS = {
    "detections": "photons detected per exposure by pixels of nominal efficiency",
    "variance": "photons squared",
    "filled": "true where neighbors replace a hot, dead or saturated pixel",
    "ambiguous": "true where the pixel may have seen much more light",
}


def corrected_path(dataset: Dataset, sensor: ImageSensor, level: LightLevel) -> Path:
    """Zarr group with corrected frames."""
    folder = dataset.root / "corrected" / dataset.sequence
    return folder / f"{exposure_name(sensor, level)}.zarr"


def open_corrected(dataset: Dataset, sensor: ImageSensor, level: LightLevel) -> StoredFrames | None:
    """Detections of the corrected frames of an exposure; None if there are none.

    Raises UserError if they cannot be read.
    """
    path = corrected_path(dataset, sensor, level)
    if not (dataset.configuration.correct and isinstance(sensor, Sensor | FrameSensor)):
        return None
    with undamaged(path, f"run: {shell_command('sense', dataset.root, '--redo')}"):
        detections = StoredFrames.open(path, "detections")
        settings = dataset.configuration
        if detections.shape != (settings.trajectory.frames, *settings.camera.shape):
            raise ValueError(f"its frames are {detections.shape}, not those of the dataset")
        return detections


def write_corrected(dataset: Dataset, sensor: ImageSensor, opened: Sequence[OpenedCounts]) -> None:
    """Correct the exposures of a sensor, at every light level, that are not corrected yet."""
    levels = dataset.configuration.light_levels
    missing = {
        path: counts
        for level, counts in zip(levels, opened, strict=True)
        if not (path := corrected_path(dataset, sensor, level)).exists()
    }
    if not missing or not isinstance(sensor, Sensor | FrameSensor):
        return
    frames, at_once = len(opened[0]["counts"]), frames_at_once(dataset.configuration)
    with progress(
        f"Correcting {sensor.name} (correct: true)", len(missing) * frames, "frame"
    ) as advance:
        settings = dataset.configuration
        device = sensor
        if settings.free_running and isinstance(sensor, Sensor):
            device = settled(sensor)
        shape, flats = settings.camera.shape, settings.calibration
        with refused_as(f"sense: {sensor.name} cannot be calibrated"):
            calibration = simulated_calibration(
                device, shape, frames=flats.frames, seed=settings.seed, hot_times=flats.hot_times
            )
        for path, counts in missing.items():
            with files.atomic_write(path) as temporary:
                group = zarr.open_group(temporary, mode="w", zarr_format=3)
                group.attrs.update(format_attribute())
                for first in range(0, frames, at_once):
                    chunk = slice(first, first + at_once)
                    readings, saturated = counts["counts"][chunk], counts["saturated"][chunk]
                    corrected = correct(readings, saturated, calibration)
                    for name, unit in _UNITS.items():
                        values = getattr(corrected, name)
                        values = values if values.dtype == np.bool_ else values.astype(np.float32)
                        axes = ("frame", "row", "column")
                        described = {"dimension_names": axes, "attributes": {"unit": unit}}
                        write_frames(group, name, first, values, frames, **described)
                    advance(len(readings))
