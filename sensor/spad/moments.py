"""Mean and variance of events and of readings, frame by frame, without drawing any."""

import numpy as np
from numpy.typing import ArrayLike

from megalopta.core.arrays import Floats
from megalopta.sensor.avalanches.counts import count_moments
from megalopta.sensor.optics.pixels import photon_rate
from megalopta.sensor.quantities import Expectation
from megalopta.sensor.spad.frames import over_frames
from megalopta.sensor.spad.model import Sensor
from megalopta.sensor.spad.rates import checked_rate, detection_rate
from megalopta.sensor.spad.readings import moments_of_readings

PARTS_ERROR = (
    "with dead time alone mean_events by at most one count a part, times the share of time dead; "
    "with afterpulsing by as much over one less mean_carriers, and the carriers that wait; "
    "events_variance by 0.1 counts squared a part, as simulated; exact without either"
)
"""What the moments of events are off by where light changes within an exposure. The bound of the
mean is derived in `count_moments`, and 0.4 of it was found; that of the variance is from simulation
of light in one of two and of eight parts, and in every other one, at r·τ of 0.1, 1 and 3 in both
kinds of dead time, with up to 0.2 carriers."""


def event_moments(
    detections_hz: ArrayLike, sensor: Sensor, threads: int | None = None
) -> tuple[Floats, Floats]:
    """Mean and variance of the events of an exposure, dark counts included, each (T, H, W).

    Parameters
    ----------
    detections_hz : (T, H, W) or (T, S, H, W) array
        Photons per second that each pixel would detect if always live (`detection_rate`), constant
        or in S equal parts of the exposure; for what the latter leaves out see `PARTS_ERROR`.
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
    radiance: ArrayLike,
    bands_nm: ArrayLike,
    sensor: Sensor,
    threads: int | None = None,
    detections_hz: ArrayLike | None = None,
) -> Expectation:
    """Mean and variance of photons, events and readings.

    Parameters are those of `expose`, but for `detections_hz`: where light changes within the
    exposures, the rates (T, S, H, W) that it makes in their parts, the radiance being its mean.
    """
    if detections_hz is None:
        detections_hz = detection_rate(radiance, bands_nm, sensor)
    photons = photon_rate(radiance, bands_nm, sensor) * sensor.exposure_s
    return Expectation(photons, *_all_moments(detections_hz, sensor, threads))


def _all_moments(
    detections_hz: ArrayLike, sensor: Sensor, threads: int | None
) -> tuple[Floats, Floats, Floats, Floats]:
    rate, device = checked_rate(detections_hz, sensor)
    moments, effects = np.empty((4, rate.shape[0], *rate.shape[-2:])), sensor.avalanche_effects

    def state(frame: int) -> None:
        arrivals_hz = rate[frame] + device.dark_counts_hz
        events = count_moments(arrivals_hz, sensor.exposure_s, effects, device.avalanches)
        arrivals = arrivals_hz * sensor.exposure_s if arrivals_hz.ndim == 2 else None
        moments[:2, frame] = events
        moments[2:, frame] = moments_of_readings(
            arrivals,
            events,
            sensor.counter,
            device.counters,
            sensor.exposure_s,
            effects,
            device.avalanches,
        )

    over_frames(state, len(rate), threads)
    return moments[0], moments[1], moments[2], moments[3]
