"""Mean and variance of events and readings, frame by frame, without drawing any."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from megalopta.core.arrays import Floats
from megalopta.sensor.change import changed
from megalopta.sensor.contrast import model as contrast
from megalopta.sensor.ctia import model as ctia
from megalopta.sensor.ctia.photodiode import ELEMENTARY_CHARGE_C
from megalopta.sensor.effects.base import AvalancheMaps
from megalopta.sensor.frame import moments as frame
from megalopta.sensor.frame.model import FrameSensor
from megalopta.sensor.image_sensors import ImageSensor, detected_hz
from megalopta.sensor.optics import checked_rate, photon_rate
from megalopta.sensor.quantities import Expectation
from megalopta.sensor.sampling.streams import over_frames
from megalopta.sensor.spad.counters import AnalogPixels
from megalopta.sensor.spad.device import draw_fixed_pattern
from megalopta.sensor.spad.model import Sensor
from megalopta.sensor.spad.moments import count_moments
from megalopta.sensor.spad.readings import moments_of_readings

_PIXELS_AT_ONCE = 2**16
"""Pixels whose moments are computed together, in some 60 MB."""


def event_moments(detections_hz: ArrayLike, sensor: Sensor) -> tuple[Floats, Floats]:
    """Mean and variance of the events of an exposure, dark counts included, each (T, H, W).

    `detections_hz`: detection rate of always-live pixels, Hz (`detection_rate`), constant (T, H, W)
    or in S equal parts of the exposure (T, S, H, W). In parts, means are off by at most one count a
    part times the share of time dead, with afterpulsing over one less mean_carriers; variances by
    0.1 counts² a part, as simulated at r·τ of 0.1 to 3; exact without either (`count_moments`).
    """
    mean, variance, _, _ = _all_moments(detections_hz, sensor)
    return mean, variance


def reading_moments(detections_hz: ArrayLike, sensor: Sensor) -> tuple[Floats, Floats]:
    """Mean and variance of the readings, each (T, H, W); as `event_moments`."""
    _, _, mean, variance = _all_moments(detections_hz, sensor)
    return mean, variance


def expectation(
    radiance: ArrayLike,
    bands_nm: ArrayLike,
    sensor: ImageSensor,
    first_frame: int = 0,
    frame_period_s: float | None = None,
    detections_hz: ArrayLike | None = None,
    state: Any = None,
) -> Expectation:
    """Mean and variance of photons, events and readings.

    Parameters are those of `expose`, plus `detections_hz`, the light of `detected_hz`, or that of
    parts where a kind takes them, of which the radiance is the mean; and `state`, that of a frame
    or event camera before. Effects that change from frame to frame are averaged over time.
    """
    if detections_hz is None:
        detections_hz = detected_hz(radiance, bands_nm, sensor)
    photons = photon_rate(radiance, bands_nm, sensor) * sensor.exposure_s
    return Expectation(photons, *moments(detections_hz, sensor, first_frame, frame_period_s, state))


def moments(
    detections_hz: ArrayLike,
    sensor: ImageSensor,
    first_frame: int = 0,
    frame_period_s: float | None = None,
    state: Any = None,
) -> Sequence[Floats]:
    """Mean and variance of events, and of readings, (T, H, W) each, as `expectation`."""
    if isinstance(sensor, Sensor):
        return list(_all_moments(detections_hz, sensor))
    if isinstance(sensor, contrast.ContrastSensor):
        return list(contrast.moments(detections_hz, sensor, state))
    light_hz = np.asarray(detections_hz)
    if isinstance(sensor, FrameSensor):
        electrons = frame.electron_moments(light_hz, sensor, state)
        return [*electrons, *frame.reading_moments(light_hz, sensor, state)]
    times = ELEMENTARY_CHARGE_C * light_hz, sensor, first_frame, frame_period_s
    mean_v, variance_v2 = ctia.volt_moments(*times)
    variance = variance_v2 * float(ctia.reading_electrons(1.0, sensor)) ** 2
    return [*ctia.electron_moments(*times), ctia.reading_electrons(mean_v, sensor), variance]


def settled(sensor: Sensor) -> Sensor:
    """Return the sensor with a stationary start of every exposure, as of an array that runs.

    Where light changes between frames, errors are those of parts in `event_moments`.
    """
    return changed(sensor, dead_time={"start": "stationary"})


def _all_moments(detections_hz: ArrayLike, sensor: Sensor) -> Floats:
    """Mean and variance of events, mean and variance of readings, (4, T, H, W)."""
    rate_hz = checked_rate(detections_hz, sensor)
    frames, *_, rows, columns = rate_hz.shape
    device = draw_fixed_pattern(sensor, (rows, columns))
    exposure_s, effects, maps = sensor.exposure_s, sensor.avalanche_effects, device.avalanches
    chances, dark_levels_hz = zip(*device.dark_levels(), strict=True)
    moments = np.empty((4, frames, rows, columns))
    # with crosstalk a pixel's moments depend on all others; what differs is interpolated for all
    is_whole = "crosstalk" in effects.on or (maps is not None and not effects.is_closed_form)
    rows_at_once = rows if is_whole else max(_PIXELS_AT_ONCE // max(columns, 1), 1)
    starts = range(0, rows, max(rows_at_once, 1))

    def fill_rows(number: int) -> None:
        frame, place = divmod(number, len(starts))
        block = slice(starts[place], starts[place] + rows_at_once)
        maps_of_rows = maps and AvalancheMaps(*(factor[block] for factor in maps))
        counters = device.counters and AnalogPixels(*(part[block] for part in device.counters))
        in_states = []
        for dark_hz in dark_levels_hz:
            arrivals_hz = rate_hz[frame][..., block, :] + dark_hz[block]
            events = count_moments(arrivals_hz, exposure_s, effects, maps_of_rows)
            arrivals = arrivals_hz * exposure_s if arrivals_hz.ndim == 2 else None
            readings = moments_of_readings(
                arrivals, events, sensor.counter, counters, exposure_s, effects, maps_of_rows
            )
            in_states.append((*events, *readings))
        if len(chances) == 1:
            moments[:, frame, block] = in_states[0]
            return
        # a mixture of distributions
        means, variances = np.array(in_states)[:, ::2], np.array(in_states)[:, 1::2]
        moments[::2, frame, block] = mean = np.tensordot(chances, means, 1)
        moments[1::2, frame, block] = np.tensordot(chances, variances + (means - mean) ** 2, 1)

    over_frames(fill_rows, range(frames * len(starts)))
    if device.stuck is not None:
        stuck = device.stuck >= 0
        moments[2][:, stuck], moments[3][:, stuck] = device.stuck[stuck], 0.0
    return moments
