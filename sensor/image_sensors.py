"""Image sensors that count (`Sensor`) or integrate (`CtiaSensor`), by name.

A CTIA array reads volts; in `expose` they are electrons, C·V/q, the dark ones included, which stand
beside the counts of a SPAD array. There is no converter: readings are float32, exact to 16
electrons at full swing, where shot noise alone is 14 000, and noise can make them negative.
"""

from pathlib import Path
from typing import Annotated, Any, TypeAlias

from numpy.typing import ArrayLike
from pydantic import Field

from megalopta.core.arrays import Floats
from megalopta.core.plug_ins import plug_ins
from megalopta.sensor.ctia.model import CTIA_PRESETS, CtiaSensor, pixels
from megalopta.sensor.optics.efficiency import band_efficiency
from megalopta.sensor.optics.pixels import detected_rate
from megalopta.sensor.spad.device import detection_rate, draw_fixed_pattern
from megalopta.sensor.spad.model import Sensor
from megalopta.sensor.spad.presets import PRESETS, load_sensor

ImageSensor: TypeAlias = Annotated[Sensor | CtiaSensor, Field(discriminator="kind")]
"""A sensor of either kind; `kind` tells which."""


def _plugged_in(value: Any) -> Sensor | CtiaSensor:
    """Return the sensor that an entry point holds: itself, or the path of its YAML file."""
    found = load_sensor(value) if isinstance(value, str | Path) else value
    if not isinstance(found, Sensor | CtiaSensor):
        raise TypeError(f"{value!r} is no Sensor, CtiaSensor or path of a YAML file, give one")
    return found


_OURS: dict[str, Sensor | CtiaSensor] = {**PRESETS, **CTIA_PRESETS}

IMAGE_SENSORS = _OURS | plug_ins("megalopta.sensors", _plugged_in, _OURS)
"""Presets of both kinds by name, those of other packages' entry points included."""


def check_sensor(sensor: ImageSensor, bands_nm: ArrayLike, shape: tuple[int, int]) -> None:
    """Make sure that a sensor can expose images of (rows, columns) pixels in these bands.

    Raises
    ------
    ValueError
        When a band reaches outside its efficiency curve, or the device cannot be made: a measured
        map is damaged or does not fit, or its figures lead beyond what is possible.
    """
    band_efficiency(sensor.efficiency, bands_nm)
    if isinstance(sensor, Sensor):
        draw_fixed_pattern(sensor, shape)
    else:
        pixels(sensor, shape)


def detected_photons(radiance: ArrayLike, bands_nm: ArrayLike, sensor: ImageSensor) -> Floats:
    """Photons detected in one exposure if nothing is lost, (T, H, W); as for `expose`."""
    if isinstance(sensor, Sensor):
        return detection_rate(radiance, bands_nm, sensor) * sensor.exposure_s
    return detected_rate(radiance, bands_nm, sensor) * sensor.exposure_s
