"""Mean and variance of events and of readings, frame by frame, without drawing any."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from megalopta.sensor import Expectation
from megalopta.sensor.avalanches import count_moments
from megalopta.sensor.optics import photon_rate
from megalopta.sensor.spad.frames import over_frames
from megalopta.sensor.spad.model import Sensor
from megalopta.sensor.spad.rates import checked_rate, detection_rate

Floats = NDArray[np.float64]


def event_moments(
    detections_hz: ArrayLike, sensor: Sensor, threads: int | None = None
) -> tuple[Floats, Floats]:
    """Mean and variance of the events of an exposure, dark counts included, each (T, H, W).

    Parameters
    ----------
    detections_hz : (T, H, W) array
        Photons per second that each pixel would detect if always live (`detection_rate`).
    sensor : Sensor
    threads : int, optional
        As for `expose`.
    """
    return _all_moments(detections_hz, sensor, threads)[:2]


def reading_moments(
    detections_hz: ArrayLike, sensor: Sensor, threads: int | None = None
) -> tuple[Floats, Floats]:
    """Mean and variance of the readings, each (T, H, W); as `event_moments`."""
    return _all_moments(detections_hz, sensor, threads)[2:]


def spad_expectation(
    radiance: ArrayLike, bands_nm: ArrayLike, sensor: Sensor, threads: int | None = None
) -> Expectation:
    """Mean and variance of photons, events and readings; parameters as for `expose`."""
    detections_hz = detection_rate(radiance, bands_nm, sensor)
    photons = photon_rate(radiance, bands_nm, sensor) * sensor.exposure_s
    return Expectation(photons, *_all_moments(detections_hz, sensor, threads))


def _all_moments(
    detections_hz: ArrayLike, sensor: Sensor, threads: int | None
) -> tuple[Floats, Floats, Floats, Floats]:
    rate, device = checked_rate(detections_hz, sensor)
    mean, variance = np.empty(rate.shape), np.empty(rate.shape)

    def state(frame: int) -> None:
        arrivals_hz = rate[frame] + device.dark_counts_hz
        mean[frame], variance[frame] = count_moments(
            arrivals_hz, sensor.exposure_s, sensor.avalanche_effects
        )

    over_frames(state, len(rate), threads)
    return mean, variance, mean, variance
