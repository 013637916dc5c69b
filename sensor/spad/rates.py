"""What a device would detect if its pixels were always live, checked."""

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from megalopta.core.arrays import Floats
from megalopta.sensor.effects.dead_time import MOST_ARRIVALS
from megalopta.sensor.optics.pixels import check_brightness, detected_rate
from megalopta.sensor.spad.fixed_pattern import FixedPattern, draw_fixed_pattern
from megalopta.sensor.spad.model import Sensor


def detection_rate(radiance: ArrayLike, bands_nm: ArrayLike, sensor: Sensor) -> Floats:
    """Photons per second that each pixel would detect if always live, (T, H, W); as `expose`."""
    _check_sensor(sensor)
    rate = detected_rate(radiance, bands_nm, sensor)
    _, rows, columns = rate.shape
    rate *= draw_fixed_pattern(sensor, (rows, columns)).efficiency_factor
    return check_brightness(rate, sensor.exposure_s)


def checked_rate(detections_hz: ArrayLike, sensor: Sensor) -> tuple[Floats, FixedPattern]:
    """Rate as (frames, [parts,] rows, columns) and the device that sees it, or refuse the rate.

    Raises
    ------
    ValueError
        When the rate has another shape, is negative, not finite or too high to be drawn.
    """
    _check_sensor(sensor)
    rate = np.asarray(detections_hz, np.float64)
    if rate.ndim not in (3, 4):
        raise ValueError(
            f"detections_hz: shape {rate.shape}; give (frames, rows, columns), or with parts of "
            "the exposure (frames, parts, rows, columns)"
        )
    most = MOST_ARRIVALS / sensor.exposure_s
    if not _are_within(rate.ravel(), most):
        raise ValueError(
            f"detections_hz: from {rate.min():g} to {rate.max():g}; must be finite, not negative "
            f"and at most {most:g} Hz ({MOST_ARRIVALS:g} an exposure)"
        )
    *_, rows, columns = rate.shape
    return rate, draw_fixed_pattern(sensor, (rows, columns))


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _are_within(values: Floats, most: float) -> bool:
    """Whether all are numbers from 0 to the most, in one pass."""
    within = np.int64(0)
    for pixel in range(values.size):  # summed, which vector instructions do
        within += np.int64(values[pixel] >= 0) & np.int64(values[pixel] <= most)
    return bool(within == values.size)


def _check_sensor(sensor: Sensor) -> None:
    if not isinstance(sensor, Sensor):
        raise TypeError(f"sensor: {sensor!r} is no Sensor; give one, such as preset('spadcam')")
