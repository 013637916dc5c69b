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

from megalopta.plug_ins import plug_ins
from megalopta.sensor.ctia import (
    CTIA_PRESETS,
    CtiaSensor,
    Floats,
    expose_ctia,
    photocurrent,
    pixels,
    reading_electrons,
    reading_moments,
)
from megalopta.sensor.optics import band_efficiency, detected_rate, photon_rate
from megalopta.sensor.spad import (
    PRESETS,
    Exposure,
    Sensor,
    detection_rate,
    draw_fixed_pattern,
    expected_counts,
    expose,
    load_sensor,
    signal_to_noise,
)

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
) -> Exposure:
    """Expose frames of a scene; parameters as for `expose` and `expose_ctia`."""
    if isinstance(sensor, Sensor):
        return expose(
            radiance, bands_nm, sensor, seed=seed, sequence=sequence, first_frame=first_frame
        )
    reading = expose_ctia(
        radiance,
        bands_nm,
        sensor,
        seed=seed,
        sequence=sequence,
        first_frame=first_frame,
        frame_period_s=frame_period_s,
    )
    return Exposure(
        reading_electrons(reading.volts, sensor).astype(np.float32),
        reading_electrons(reading.expected, sensor),
        reading.saturated,
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


def incident_photons(radiance: ArrayLike, bands_nm: ArrayLike, sensor: ImageSensor) -> Floats:
    """Photons that fall on each pixel in one exposure, (T, H, W); parameters as for `expose`."""
    return photon_rate(radiance, bands_nm, sensor) * sensor.exposure_s


def detected_photons(radiance: ArrayLike, bands_nm: ArrayLike, sensor: ImageSensor) -> Floats:
    """Photons detected in one exposure if nothing is lost, (T, H, W); as `incident_photons`."""
    if isinstance(sensor, Sensor):
        return detection_rate(radiance, bands_nm, sensor) * sensor.exposure_s
    return detected_rate(radiance, bands_nm, sensor) * sensor.exposure_s


def expected_reading(radiance: ArrayLike, bands_nm: ArrayLike, sensor: ImageSensor) -> Floats:
    """Mean reading, dark counts or electrons included, (T, H, W); as `incident_photons`."""
    if isinstance(sensor, Sensor):
        return expected_counts(radiance, bands_nm, sensor)
    mean, _ = reading_moments(photocurrent(radiance, bands_nm, sensor), sensor)
    return reading_electrons(mean, sensor)


def reading_signal_to_noise(
    radiance: ArrayLike, bands_nm: ArrayLike, sensor: ImageSensor
) -> Floats:
    """What the light adds to a reading over its standard deviation, (T, H, W); as `expose`."""
    if isinstance(sensor, Sensor):
        return signal_to_noise(radiance, bands_nm, sensor)
    light = photocurrent(radiance, bands_nm, sensor)
    mean, variance = reading_moments(light, sensor)
    signal = mean - reading_moments(0 * light[:1], sensor)[0]
    return np.divide(signal, np.sqrt(variance), out=np.zeros_like(signal), where=variance > 0)
