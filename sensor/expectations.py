"""Mean and variance of events and readings, frame by frame, without drawing any."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from megalopta.core.arrays import Floats
from megalopta.sensor import optics
from megalopta.sensor.change import changed
from megalopta.sensor.contrast import model as contrast
from megalopta.sensor.ctia import model as ctia
from megalopta.sensor.ctia.photodiode import ELEMENTARY_CHARGE_C
from megalopta.sensor.effects.base import AvalancheMaps
from megalopta.sensor.effects.crosstalk import first_arrivals
from megalopta.sensor.frame import moments as frame
from megalopta.sensor.frame.model import FrameSensor
from megalopta.sensor.image_sensors import ImageSensor, detected_hz
from megalopta.sensor.quantities import Expectation
from megalopta.sensor.sampling.streams import over_frames
from megalopta.sensor.spad.array import lights_of_sum
from megalopta.sensor.spad.counters import AnalogPixels
from megalopta.sensor.spad.device import draw_fixed_pattern
from megalopta.sensor.spad.model import Sensor
from megalopta.sensor.spad.moments import count_moments, mean_rate, open_rate
from megalopta.sensor.spad.readings import moments_of_readings


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
    parts where a kind takes them, of which the radiance is the mean; and `state`, that of the
    array before. Effects that change from frame to frame are averaged over time.
    """
    if detections_hz is None:
        detections_hz = detected_hz(radiance, bands_nm, sensor)
    photons = optics.photon_rate(radiance, bands_nm, sensor) * sensor.exposure_s
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
        return list(_all_moments(detections_hz, sensor, *(state[1:] if state else ())))
    if isinstance(sensor, contrast.ContrastSensor):
        return list(contrast.moments(detections_hz, sensor, state))
    light_hz = np.asarray(detections_hz)
    if isinstance(sensor, FrameSensor):
        electrons = frame.electron_moments(light_hz, sensor, state)
        return [*electrons, *frame.reading_moments(light_hz, sensor, state)]
    times = ELEMENTARY_CHARGE_C * light_hz, sensor, first_frame, frame_period_s
    mean_v, variance_v2 = ctia.volt_moments(*times, 0.0 if state is None else state)
    variance = variance_v2 * float(ctia.reading_electrons(1.0, sensor)) ** 2
    return [*ctia.electron_moments(*times), ctia.reading_electrons(mean_v, sensor), variance]


def settled(sensor: Sensor) -> Sensor:
    """Return the sensor with a stationary start of every exposure, as of an array that runs.

    Where light changes between frames, errors are those of parts in `event_moments`.
    """
    return changed(sensor, dead_time={"start": "stationary"})


def _all_moments(
    detections_hz: ArrayLike, sensor: Sensor, behind: Floats | None = None, counted: Any = 0.0
) -> Floats:
    """Mean and variance of events, mean and variance of readings, (4, T, H, W)."""
    rate_hz, _ = optics.with_lag(optics.checked_rate(detections_hz, sensor), sensor, behind)
    frames, *_, rows, columns = rate_hz.shape
    device, sums = draw_fixed_pattern(sensor, (rows, columns)), sensor.counter.sums
    exposure_s, effects, maps = sensor.counted_s, sensor.avalanche_effects, device.avalanches
    # whether there is an event: exact, where the distribution of their number is not
    is_bit = sensor.counter.capacity == 1 and not (effects.on <= {"gate"} or effects.is_closed_form)
    is_bit &= effects.dead_time.start == "live" or not effects.has_memory
    is_bit &= getattr(sensor.counter, "overflow", "") == "saturate"
    chances, dark_levels_hz = zip(*device.dark_levels(), strict=True)
    moments = np.empty((4, frames, rows, columns))
    # with crosstalk a pixel's moments depend on all others; what differs is interpolated for all
    is_whole = "crosstalk" in effects.on or (maps is not None and not effects.is_closed_form)
    rows_at_once = rows if is_whole else max(2**16 // max(columns, 1), 1)  # pixels in 60 MB
    starts = range(0, rows, max(rows_at_once, 1))
    residue = getattr(sensor.counter, "residue_share", 0.0)
    kept = np.array([residue, residue**2]).reshape(2, 1, 1)
    held = np.zeros((2, rows, columns))  # mean and variance of events in analog counters
    held[0], most = counted, float(sensor.counter.capacity)

    def fill_rows(number: int) -> None:
        frame, place = divmod(number, len(starts))
        block = slice(starts[place], starts[place] + rows_at_once)
        maps_of_rows = maps and AvalancheMaps(*(factor[block] for factor in maps))
        counters = device.counters and AnalogPixels(*(part[block] for part in device.counters))
        in_states: list[Any] = []
        for dark_hz in dark_levels_hz:
            in_states.append(0.0)
            for light_hz, exposures in lights_of_sum(rate_hz[frame][..., block, :], sums):
                arrivals_hz = light_hz + dark_hz[block]
                events = count_moments(arrivals_hz, exposure_s, effects, maps_of_rows)
                is_steady = arrivals_hz.ndim == 2 and not residue
                if is_bit:
                    if arrivals_hz.ndim == 3:
                        arrivals_hz = mean_rate(arrivals_hz, exposure_s, effects)
                    own = open_rate(arrivals_hz, exposure_s, effects) * exposure_s
                    talk = effects.crosstalk, maps_of_rows and maps_of_rows.crosstalk
                    chance = -np.expm1(-first_arrivals(own, events[0], *talk))
                    readings = chance, chance * (1 - chance)
                else:
                    mean, variance = events + kept * held[:, block]
                    arrivals = arrivals_hz * exposure_s if is_steady else None
                    counter = sensor.counter, counters, exposure_s, effects, maps_of_rows
                    readings = moments_of_readings(arrivals, (mean, variance), *counter)
                in_states[-1] = in_states[-1] + exposures * np.array((*events, *readings))
        # a mixture of distributions
        means, variances = np.array(in_states)[:, ::2], np.array(in_states)[:, 1::2]
        moments[::2, frame, block] = center = np.tensordot(chances, means, 1)
        moments[1::2, frame, block] = np.tensordot(chances, variances + (means - center) ** 2, 1)
        held[:, block] = moments[:2, frame, block] + kept * held[:, block]
        held[:, block][:, held[0, block] >= most] = np.array([[most], [0.0]])

    over_frames(fill_rows, range(frames * len(starts)), in_turn=residue > 0)
    if device.stuck is not None:
        stuck = device.stuck >= 0
        moments[2][:, stuck], moments[3][:, stuck] = device.stuck[stuck], 0.0
    return moments
