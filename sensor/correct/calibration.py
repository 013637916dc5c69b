"""What has to be known of a device: its dark counts, its flat field, its hot pixels.

Dark frames are taken without light, flat frames under even light, as many of each as patience
allows; both may be captured or simulated. They are linearized frame by frame before they are
averaged, as everything is.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from megalopta.sensor import expose_rate
from megalopta.sensor.correct.defects import hot_pixels
from megalopta.sensor.correct.response_curve import ResponseCurve, response_curve
from megalopta.sensor.spad import Sensor, draw_fixed_pattern

Floats = NDArray[np.float64]

_DEADEST = 0.2
"""Of the median response; a pixel below it is as good as dead."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """A device, each map (rows, columns).

    Attributes
    ----------
    curve : ResponseCurve
        Readings to arrivals.
    dark, dark_variance : arrays
        Dark counts in an exposure, and the variance of this estimate.
    gain, gain_variance : arrays
        Efficiency relative to the sensor's curve, or to the mean of the good pixels.
    bad : array of bool
        Hot or dead pixels.
    """

    curve: ResponseCurve
    dark: Floats
    dark_variance: Floats
    gain: Floats
    gain_variance: Floats
    bad: NDArray[np.bool_]


def calibrate(
    dark_frames: ArrayLike,
    flat_frames: ArrayLike,
    sensor: Sensor,
    *,
    flat_detections: float | None = None,
    hot_times: float = 10.0,
) -> Calibration:
    """Return what dark and flat frames tell of a device.

    Parameters
    ----------
    dark_frames, flat_frames : (n, rows, columns)
        Readings without light and under even light, with the exposure of the sensor.
    sensor : Sensor
        Its dead time, afterpulses, counter and so on.
    flat_detections : float, optional
        Photons per exposure that a pixel of nominal efficiency detects of the even light. Without
        it gains are relative to the mean of the good pixels.
    hot_times : float
        Pixels with more dark counts than so many times the median are hot.

    Raises
    ------
    ValueError
        When there are fewer than two frames, shapes differ, or the flat frames are too dark or too
        bright to tell a gain.
    """
    dark_readings, flat_readings = (
        _frames(name, frames) for name, frames in (("dark", dark_frames), ("flat", flat_frames))
    )
    if dark_readings.shape[1:] != flat_readings.shape[1:]:
        raise ValueError(
            f"dark frames of {dark_readings.shape[1:]} and flat frames of "
            f"{flat_readings.shape[1:]} pixels: give those of one device"
        )
    curve = response_curve(sensor)
    dark, dark_variance = _mean(dark_readings, curve)
    flat, flat_variance = _mean(flat_readings, curve)
    light = flat - dark
    bad = hot_pixels(dark, hot_times)
    bad |= (flat_readings.mean(axis=0) >= 0.95 * curve.largest) | (
        light < _DEADEST * np.median(light)
    )
    if bad.all() or not np.median(light) > 0:
        raise ValueError(
            "flat frames: too dark or too bright to tell how pixels differ; readings well above "
            f"the dark and below {curve.largest:.4g} are needed"
        )
    even = float(light[~bad].mean()) if flat_detections is None else flat_detections
    return Calibration(
        curve,
        dark,
        dark_variance,
        np.where(bad, 1.0, light / even),
        (flat_variance + dark_variance) / even**2,
        bad,
    )


def simulated_calibration(
    sensor: Sensor,
    shape: tuple[int, int],
    *,
    frames: int = 256,
    seed: int = 0,
    hot_times: float = 10.0,
) -> Calibration:
    """Calibrate a simulated device on frames drawn in the dark and under light for a half reading.

    Parameters
    ----------
    sensor : Sensor
    shape : (rows, columns)
    frames : int
        Of each kind.
    seed : int
    hot_times : float
        As for `calibrate`.
    """
    curve = response_curve(sensor)
    detections = float(curve.arrivals_of(np.array([curve.largest / 2]))[0][0])
    even = np.full((frames, *shape), detections / sensor.exposure_s)
    factor = draw_fixed_pattern(sensor, shape).efficiency_factor
    dark, flat = (
        expose_rate(rate, sensor, seed=seed, sequence=f"calibration {name}").counts
        for name, rate in (("dark", 0 * even), ("flat", even * factor))
    )
    return calibrate(dark, flat, sensor, flat_detections=detections, hot_times=hot_times)


def _frames(name: str, frames: ArrayLike) -> Floats:
    readings = np.asarray(frames, np.float64)
    if readings.ndim != 3 or len(readings) < 2:
        raise ValueError(
            f"{name} frames: shape {readings.shape}; give (frames, rows, columns), two or more"
        )
    return readings


def _mean(readings: Floats, curve: ResponseCurve) -> tuple[Floats, Floats]:
    """Mean arrivals over frames, and the variance of that."""
    arrivals, _ = curve.arrivals_of(readings)
    return arrivals.mean(axis=0), arrivals.var(axis=0, ddof=1) / len(readings)
