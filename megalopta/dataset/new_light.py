"""Any sensor at any light on frames that are rendered already."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.config.drawing import repeated_name
from megalopta.config.model import Configuration, LightLevel
from megalopta.config.yaml_model import validated
from megalopta.core.errors import UserError
from megalopta.dataset.lazy import LazyFrames
from megalopta.dataset.store import Dataset, exposure_name
from megalopta.sensor import ImageSensor, expose, merged


def drawn_counts(
    dataset: Dataset,
    sensor: Any,
    level: LightLevel | None,
    gain: float,
    repeat: int,
    changes: Mapping[str, Any],
) -> LazyFrames:
    """Readings (T, H, W) of a sensor, each frame drawn when it is asked for."""
    settings = dataset.configuration
    chosen = level if level is not None else settings.light.resolved().illuminance_lux
    device = repeated_name(sensor_of(settings, sensor, changes), repeat)
    exposed = with_exposure(settings, device, chosen)
    if not gain > 0:
        raise UserError(f"gain {gain!r}: give a number above 0")

    def read(numbers: list[int]) -> NDArray[Any]:
        from megalopta.config.light_scale import light_scale
        from megalopta.dataset.frames import read_radiance_frame

        scale = (light_scale(exposed, chosen) * gain).astype(np.float32)
        sequence = f"{dataset.sequence}/{exposure_name(device, chosen)}"
        sequence += f"/gain {gain!r}" if gain != 1 else ""
        return np.concatenate(
            [
                expose(
                    read_radiance_frame(dataset, number)[np.newaxis] * scale,
                    settings.render.bands_nm,
                    device,
                    seed=settings.seed,
                    sequence=sequence,
                    first_frame=number,
                    frame_period_s=1 / settings.trajectory.frame_rate_hz,
                ).counts
                for number in numbers
            ]
        )

    shape = settings.trajectory.frames, settings.camera.height, settings.camera.width
    dtype = np.dtype(np.float32 if device.unit == "electrons" else np.uint32)
    return LazyFrames(shape, dtype, f"{device.unit} per exposure", ("frame", "row", "column"), read)


def sensor_of(settings: Configuration, sensor: Any, changes: Mapping[str, Any]) -> ImageSensor:
    """Sensor of a preset's name, fields or a sensor, with changes. Raises UserError."""
    if hasattr(sensor, "model_dump"):
        fields: dict[str, Any] = sensor.model_dump(mode="json")
    else:
        fields = {"preset": sensor} if isinstance(sensor, str) else dict(sensor)
    values = settings.model_dump(mode="json", exclude={"sensors"})
    changed = merged(fields, changes)
    return validated(Configuration, {**values, "sensors": [changed]}, "expose").sensors[0]


def with_exposure(settings: Configuration, sensor: ImageSensor, level: LightLevel) -> Configuration:
    """The configuration with one sensor at one level. Raises UserError."""
    values = settings.model_dump(mode="json", exclude={"sensors", "light_levels"})
    values |= {"sensors": [sensor.model_dump(mode="json")], "light_levels": [level]}
    return validated(Configuration, values, "expose")
