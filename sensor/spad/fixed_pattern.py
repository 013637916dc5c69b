"""One device of a kind: the fixed pattern of its pixels, the same in every frame, run and machine.

Drawn from the device seed, or read from measured maps. Bias, mismatch and temperature act here:
they change what a pixel is, not what happens in an exposure.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from megalopta.sensor.counters import AnalogCounter, AnalogPixels, analog_pixels
from megalopta.sensor.effects import MOST_ARRIVALS, bias, dark_count_rate, temperature
from megalopta.sensor.spad.measured import load_map
from megalopta.sensor.spad.model import Sensor

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Device:
    """Pixels of one device.

    Attributes
    ----------
    efficiency_factor : (H, W) float64
        Detection efficiency relative to the sensor's curve.
    dark_counts_hz : (H, W) float64
        Dark count rate at this bias and temperature.
    counters : AnalogPixels or None
        Steps and leaks of analog counters.
    """

    efficiency_factor: Floats
    dark_counts_hz: Floats
    counters: AnalogPixels | None


def fabricate(sensor: Sensor, shape: tuple[int, int]) -> Device:
    """Make the device that a sensor describes, with (rows, columns) pixels.

    Raises
    ------
    ValueError
        When a measured map does not fit, an efficiency would exceed 1, or dark counts would be
        beyond all measure.
    """
    # files may change, drawn patterns cannot
    make = _fabricate if sensor.measured.has_any else _fabricate_once
    return make(sensor, shape)


def _fabricate(sensor: Sensor, shape: tuple[int, int]) -> Device:
    offset = _breakdown_offset(sensor, shape)
    counters = (
        analog_pixels(sensor.counter, shape, sensor.exposure_s, sensor.device_seed)
        if isinstance(sensor.counter, AnalogCounter)
        else None
    )
    device = Device(_efficiency_factor(sensor, offset), _dark_counts_hz(sensor, offset), counters)
    for pattern in (device.efficiency_factor, device.dark_counts_hz, *(counters or ())):
        pattern.flags.writeable = False
    return device


_fabricate_once = lru_cache(maxsize=8)(_fabricate)


def _breakdown_offset(sensor: Sensor, shape: tuple[int, int]) -> Floats:
    measured = sensor.measured.breakdown
    if measured is not None:
        fit, lowest = sensor.measured.fit, -np.finfo(float).max
        return load_map(measured, shape, "measured.breakdown", fit=fit, lowest=lowest)
    return bias.breakdown_offset(sensor.bias, shape, sensor.device_seed)


def _efficiency_factor(sensor: Sensor, offset: Floats) -> Floats:
    measured = sensor.measured.efficiency
    if measured is None:
        factor = bias.efficiency_factor(sensor.bias, offset)
    else:
        factor = load_map(measured, offset.shape, "measured.efficiency", fit=sensor.measured.fit)
        factor *= bias.since_measurement(bias.efficiency_factor, sensor.bias, offset)
    largest = float(factor.max(initial=0)) * max(sensor.efficiency.values)
    if largest > 1:
        raise ValueError(
            f"efficiency: {largest:g} in the best pixel; lower efficiency.values, "
            "measured.efficiency or bias.excess_v so that it is at most 1"
        )
    return factor


def _dark_counts_hz(sensor: Sensor, offset: Floats) -> Floats:
    measured = sensor.measured.dark_counts
    if measured is None:
        area_m2, seed = sensor.active_area_m2, sensor.device_seed
        rate = dark_count_rate(sensor.dark_counts, offset.shape, area_m2, seed)
        rate *= bias.dark_count_factor(sensor.bias, offset)
    else:
        rate = load_map(measured, offset.shape, "measured.dark_counts", fit=sensor.measured.fit)
        rate *= bias.since_measurement(bias.dark_count_factor, sensor.bias, offset)
    with np.errstate(invalid="ignore"):
        rate *= temperature.dark_count_factor(sensor.temperature)
    largest = float(rate.max(initial=0))
    if not largest * sensor.exposure_s <= MOST_ARRIVALS:
        raise ValueError(
            f"dark_counts: {largest:g} Hz in the worst pixel at bias.excess_v "
            f"{sensor.bias.excess_v:g} and temperature.celsius {sensor.temperature.celsius:g}; "
            f"lower these, at most {MOST_ARRIVALS / sensor.exposure_s:g} Hz can be drawn"
        )
    return rate
