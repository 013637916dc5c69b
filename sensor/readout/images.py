"""Image sensors that count (`Sensor`) or integrate (`CtiaSensor`) through one set of functions.

A CTIA array reads volts; here they are electrons, C·V/q, the dark ones included, which stand beside
the counts of a SPAD array. There is no converter: readings are float32, exact to 16 electrons at
full swing, where shot noise alone is 14 000, and noise can make them negative.
"""

from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from megalopta.core.arrays import Floats
from megalopta.core.plug_ins import plug_ins
from megalopta.sensor.ctia.array import (
    electron_moments,
    expose_photocurrent,
    photocurrent,
    reading_electrons,
    volt_moments,
)
from megalopta.sensor.ctia.model import CTIA_PRESETS, CtiaSensor, pixels
from megalopta.sensor.optics.efficiency import band_efficiency
from megalopta.sensor.optics.pixels import detected_rate, photon_rate
from megalopta.sensor.quantities import Expectation, Exposure
from megalopta.sensor.spad.exposure import expose
from megalopta.sensor.spad.fixed_pattern import draw_fixed_pattern
from megalopta.sensor.spad.model import Sensor
from megalopta.sensor.spad.moments import spad_expectation
from megalopta.sensor.spad.presets import PRESETS, load_sensor
from megalopta.sensor.spad.rates import detection_rate

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


def expose_image(
    radiance: ArrayLike,
    bands_nm: ArrayLike,
    sensor: ImageSensor,
    *,
    seed: int,
    sequence: str | int,
    first_frame: int = 0,
    frame_period_s: float | None = None,
    expectation: bool = False,
) -> Exposure:
    """Expose frames (T, H, W, bands); parameters as for `expose` and `expose_photocurrent`."""
    if isinstance(sensor, Sensor):
        return expose(
            radiance,
            bands_nm,
            sensor,
            seed=seed,
            sequence=sequence,
            first_frame=first_frame,
            expectation=expectation,
        )
    reading = expose_photocurrent(
        photocurrent(radiance, bands_nm, sensor),
        sensor,
        seed=seed,
        sequence=sequence,
        first_frame=first_frame,
        frame_period_s=frame_period_s,
    )
    return Exposure(
        reading_electrons(reading.volts, sensor).astype(np.float32),
        reading.saturated,
        _ctia_expectation(radiance, bands_nm, sensor, first_frame, frame_period_s)
        if expectation
        else None,
    )


def expectation(
    radiance: ArrayLike,
    bands_nm: ArrayLike,
    sensor: ImageSensor,
    first_frame: int = 0,
    frame_period_s: float | None = None,
) -> Expectation:
    """Mean and variance (T, H, W) of photons, events and readings; parameters as `expose_image`."""
    if isinstance(sensor, Sensor):
        return spad_expectation(radiance, bands_nm, sensor)
    return _ctia_expectation(radiance, bands_nm, sensor, first_frame, frame_period_s)


def _ctia_expectation(
    radiance: ArrayLike,
    bands_nm: ArrayLike,
    sensor: CtiaSensor,
    first_frame: int,
    frame_period_s: float | None,
) -> Expectation:
    light = photocurrent(radiance, bands_nm, sensor)
    mean_v, variance_v2 = volt_moments(light, sensor, first_frame, frame_period_s)
    return Expectation(
        photon_rate(radiance, bands_nm, sensor) * sensor.exposure_s,
        *electron_moments(light, sensor, first_frame, frame_period_s),
        reading_electrons(mean_v, sensor),
        variance_v2 * float(reading_electrons(1.0, sensor)) ** 2,
    )


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
