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
from megalopta.sensor import merged


def drawn_counts(
    dataset: Dataset,
    sensor: Any,
    level: LightLevel | None,
    gain: float,
    repeat: int,
    changes: Mapping[str, Any],
) -> LazyFrames:
    """Readings (T, H, W) of a sensor, each frame drawn when it is asked for. Raises UserError."""
    settings = dataset.configuration
    chosen = level if level is not None else settings.light.resolved().illuminance_lux
    exposed = _exposed(settings, sensor, changes, chosen)
    device = repeated_name(exposed.sensors[0], repeat)
    if not gain > 0:
        raise UserError(f"gain {gain!r}: give a number above 0")

    def read(numbers: list[int]) -> NDArray[Any]:
        from megalopta.config.light_scale import light_scale
        from megalopta.dataset.frames import read_radiance_frame
        from megalopta.sensor.formats.shot import Shot

        scale = (light_scale(exposed, chosen) * gain).astype(np.float32)
        sequence = f"{dataset.sequence}/{exposure_name(device, chosen)}"
        sequence += f"/gain {gain!r}" if gain != 1 else ""
        frames = []
        for number in numbers:
            shot = Shot(
                radiance=read_radiance_frame(dataset, number)[np.newaxis] * scale,
                bands_nm=settings.render.bands_nm,
                sensor=device,
                seed=settings.seed,
                sequence=sequence,
                first_frame=number,
                frame_period_s=1 / settings.trajectory.frame_rate_hz,
            )
            frames.append(shot.exposure.counts)
        return np.concatenate(frames)

    shape = settings.trajectory.frames, settings.camera.height, settings.camera.width
    dtype = np.dtype(np.float32 if device.unit == "electrons" else np.uint32)
    return LazyFrames(shape, dtype, f"{device.unit} per exposure", ("frame", "row", "column"), read)


def _exposed(
    settings: Configuration, sensor: Any, changes: Mapping[str, Any], level: LightLevel
) -> Configuration:
    """The configuration with one sensor, a preset's name, fields or a sensor, at one level."""
    if hasattr(sensor, "model_dump"):
        sensor = sensor.model_dump(mode="json")
    fields = {"preset": sensor} if isinstance(sensor, str) else dict(sensor)
    values = settings.model_dump(mode="json", exclude={"sensors", "light_levels"})
    values |= {"sensors": [merged(fields, changes)], "light_levels": [level]}
    return validated(Configuration, values, "expose")
