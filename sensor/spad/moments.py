"""Mean and variance of events and of readings, frame by frame, without drawing any."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from megalopta.arrays import Floats
from megalopta.sensor import Expectation
from megalopta.sensor.avalanches import count_moments
from megalopta.sensor.counters import (
    AnalogPixels,
    counter_moments,
    events_until_full,
    simple_moments,
)
from megalopta.sensor.optics import photon_rate
from megalopta.sensor.spad.event_law import event_law, reach_of_events
from megalopta.sensor.spad.fixed_pattern import FixedPattern
from megalopta.sensor.spad.frames import over_frames
from megalopta.sensor.spad.model import Sensor
from megalopta.sensor.spad.rates import checked_rate, detection_rate

_LARGEST_LAW = 100_000
"""Probabilities of pixels that are treated together: they stay in a processor's second cache."""

PARTS_ERROR = (
    "with dead time alone mean_events by at most one count a part, times the share of time dead; "
    "with afterpulsing by as much over one less mean_carriers, and the carriers that wait; "
    "events_variance by 0.1 counts squared a part, as simulated; exact without either"
)
"""What the moments of events are off by where light changes within an exposure. The bound of the
mean is derived in `count_moments`, and 0.4 of it was found; that of the variance is from simulation
of light in one of two and of eight parts, and in every other one, at r·τ of 0.1, 1 and 3 in both
kinds of dead time, with up to 0.2 carriers."""

Places = NDArray[np.intp]


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
    moments = np.empty((4, rate.shape[0], *rate.shape[-2:]))

    def state(frame: int) -> None:
        arrivals_hz = rate[frame] + device.dark_counts_hz
        events = count_moments(
            arrivals_hz, sensor.exposure_s, sensor.avalanche_effects, device.avalanches
        )
        arrivals = arrivals_hz * sensor.exposure_s if arrivals_hz.ndim == 2 else None
        moments[:2, frame] = events
        moments[2:, frame] = _of_readings(arrivals, events, sensor, device)

    over_frames(state, len(rate), threads)
    return moments[0], moments[1], moments[2], moments[3]


def _of_readings(
    arrivals: Floats | None, events: tuple[Floats, Floats], sensor: Sensor, device: FixedPattern
) -> tuple[Floats, Floats]:
    """Mean and variance of the readings of a frame, by law only where that is needed.

    Arrivals are those of steady light.
    """
    counter, all_pixels, effects = sensor.counter, device.counters, sensor.avalanche_effects
    is_alone = effects.on == {"dead_time"} and effects.dead_time.has_law and not device.avalanches
    has_law = is_alone and arrivals is not None
    arrivals = events[0] if arrivals is None else arrivals
    reach = reach_of_events(*events)
    simple_mean, simple_variance, needs_law = simple_moments(counter, all_pixels, events, reach)
    mean, variance = np.array(simple_mean), np.array(simple_variance)
    until = np.broadcast_to(events_until_full(counter, all_pixels), mean.shape)
    is_full = reach[0] >= until
    for chosen in _groups(needs_law, np.where(is_full, 0, reach[1] - reach[0])):
        first, law = until[chosen], np.ones((len(chosen[0]), 1))
        if not is_full[chosen].all():
            first, within = reach[0][chosen], (events[0][chosen], events[1][chosen])
            law = event_law(
                arrivals[chosen],
                within,
                sensor.exposure_s,
                effects,
                reach[:, chosen[0], chosen[1]],
                has_law,
            )
        pixels = AnalogPixels(*(each[chosen] for each in all_pixels)) if all_pixels else None
        mean[chosen], variance[chosen] = counter_moments(
            counter, pixels, sensor.exposure_s, first, law
        )
    return mean, variance


def _groups(needs_law: NDArray[np.bool_], width: Floats) -> Iterator[tuple[Places, Places]]:
    """Pixels, in groups of about equal width, whose laws fit into memory."""
    places = np.flatnonzero(needs_law)
    places = places[np.argsort(width.ravel()[places], kind="stable")]
    while places.size:
        widths = width.ravel()[places]
        fits = (widths + 1) * np.arange(1, places.size + 1) <= _LARGEST_LAW
        size = max(int(fits.sum()), 1)
        if widths[0] == 0:  # full
            size = min(size, int((widths == 0).sum()))
        rows, columns = np.unravel_index(places[:size], needs_law.shape)
        yield rows, columns
        places = places[size:]
