"""Image sensors by name: counting (`Sensor`) or integrating (`CtiaSensor`).

A CTIA array reads volts; `expose` converts them to electrons, C·V/q, including dark ones,
comparable to the counts of a SPAD array. There is no ADC: readings are float32, exact to 16
electrons at full swing, where shot noise alone is 14 000, and noise can make them negative.
"""

from pathlib import Path
from typing import Annotated, Any, TypeAlias

from numpy.typing import ArrayLike
from pydantic import Field

from megalopta.core.arrays import Floats
from megalopta.core.errors import nearest
from megalopta.core.plug_ins import plug_ins
from megalopta.sensor.ctia.model import CTIA_PRESETS, CtiaSensor, pixels
from megalopta.sensor.optics import band_means, detected_rate
from megalopta.sensor.spad.array import detection_rate
from megalopta.sensor.spad.device import draw_fixed_pattern
from megalopta.sensor.spad.model import Sensor
from megalopta.sensor.spad.presets import PRESETS, load_sensor

ImageSensor: TypeAlias = Annotated[Sensor | CtiaSensor, Field(discriminator="kind")]
"""Sensor of either kind, distinguished by `kind`."""


def _plugged_in(value: Any) -> Sensor | CtiaSensor:
    """Return the sensor of an entry point: itself, or the path of its YAML file."""
    sensor = load_sensor(value) if isinstance(value, str | Path) else value
    if not isinstance(sensor, Sensor | CtiaSensor):
        raise TypeError(f"{value!r} is not a Sensor, CtiaSensor or path of a YAML file; give one")
    return sensor


_OURS: dict[str, Sensor | CtiaSensor] = {**PRESETS, **CTIA_PRESETS}

IMAGE_SENSORS = _OURS | plug_ins("megalopta.sensors", _plugged_in, _OURS)
"""Presets of both kinds by name, including entry points of other packages."""


def sensor_named(sensor: ImageSensor | str | Path) -> ImageSensor:
    """Return a sensor, or the one with a name or of a YAML file. Raises ValueError if unknown."""
    if not isinstance(sensor, str | Path):
        return sensor
    if (name := str(sensor)).endswith((".yaml", ".yml")):
        return load_sensor(name)
    if name not in IMAGE_SENSORS:
        raise ValueError(f"sensor {name!r} is unknown; {nearest(name, IMAGE_SENSORS)}")
    return IMAGE_SENSORS[name]


def check_sensor(sensor: ImageSensor, bands_nm: ArrayLike, shape: tuple[int, int]) -> None:
    """Check that a sensor can expose images of (rows, columns) pixels in these bands.

    Raises ValueError if a band reaches outside its efficiency curve, or the device is impossible: a
    measured map is damaged or does not fit, or its values exceed the limits.
    """
    for filters, _ in sensor.filters.parts(shape):
        band_means([sensor.efficiency, *filters], bands_nm)
    if isinstance(sensor, Sensor):
        draw_fixed_pattern(sensor, shape)
    else:
        pixels(sensor, shape)


def detected_photons(radiance: ArrayLike, bands_nm: ArrayLike, sensor: ImageSensor) -> Floats:
    """Photons detected in one exposure without losses, (T, H, W); parameters as for `expose`."""
    if isinstance(sensor, Sensor):
        return detection_rate(radiance, bands_nm, sensor) * sensor.exposure_s
    return detected_rate(radiance, bands_nm, sensor) * sensor.exposure_s
