"""Histograms of photons by their time after a pulse, per pixel and frame (`effects.timing`)."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from megalopta.core.arrays import Floats
from megalopta.sensor.effects.timing import first_photon_shares
from megalopta.sensor.optics import checked_rate
from megalopta.sensor.sampling.streams import generator, light_key, over_frames, sensor_stream
from megalopta.sensor.spad.device import draw_fixed_pattern
from megalopta.sensor.spad.model import Sensor

_MOST_PERIODS = 4e9
"""Most periods of an exposure, whose counts still fit uint32"""
_MOST_NUMBERS = 1e8
"""Most bins of all pixels of a frame, drawn in some 20 s"""
_MOST_WRAPPED = 100
"""Most periods that a standard deviation or a decay lasts"""


def check_histograms(sensor: Sensor) -> None:
    """Raise ValueError if a sensor has no histograms, as bins or pixels ready at every pulse."""
    tcspc = sensor.tcspc
    if not tcspc.is_on:
        raise ValueError(
            f"tcspc.bins: 0 in sensor {sensor.name!r}; give the bins of a period for histograms"
        )
    period_s = tcspc.period_s
    wrapped_s, shorter = _MOST_WRAPPED * period_s, f"or give {_MOST_WRAPPED} longer periods"
    for field, time_s, most_s, remedy in (
        ("tcspc.period_s", period_s, sensor.exposure_s, "or expose for many periods"),
        ("exposure_s", sensor.exposure_s, _MOST_PERIODS * period_s, "more periods overflow counts"),
        ("tcspc.pulse_sigma_s", tcspc.pulse_sigma_s, wrapped_s, shorter),
        ("tcspc.decay_s", tcspc.decay_s, wrapped_s, shorter),
        ("jitter.sigma_s", sensor.jitter.sigma_s, wrapped_s, shorter),
        ("jitter.tail_s", sensor.jitter.tail_s, wrapped_s, shorter),
        ("dead_time.dead_time_s", sensor.dead_time.dead_time_s, period_s,
         "histograms need pixels that are ready at every pulse"),
    ):  # fmt: skip
        if time_s > most_s:
            raise ValueError(f"{field}: {time_s:g}; give at most {most_s:g} s: {remedy}")
    for name in ("gate", "afterpulsing", "crosstalk", "telegraph"):
        if getattr(sensor, name).is_on:
            raise ValueError(
                f"{name}: histograms do not include it; switch it off, or sort the times of "
                "expose_events"
            )


def mean_histograms(
    detections_hz: ArrayLike, sensor: Sensor, later_s: ArrayLike | None = None
) -> Floats:
    """Return the mean counts in each bin, (T, H, W, bins); of n periods, variance m·(1 − m/n).

    Parameters as for `expose_histograms`. Raises ValueError as this does.
    """
    check_histograms(sensor)
    return periods(sensor) * _shares(detections_hz, sensor, later_s)


def _shares(detections_hz: ArrayLike, sensor: Sensor, later_s: ArrayLike | None) -> Floats:
    """Return the probability of a count in each bin of a period, (T, H, W, bins)."""
    rate = checked_rate(detections_hz, sensor)
    device = draw_fixed_pattern(sensor, (rate.shape[-2], rate.shape[-1]))
    if rate.ndim != 3:
        raise ValueError("detections_hz: light in parts of the exposure; histograms need steady")
    tcspc = sensor.tcspc
    numbers = rate[0].size * tcspc.bins if len(rate) else 0
    if numbers > _MOST_NUMBERS:
        raise ValueError(
            f"tcspc.bins: {tcspc.bins} in {rate.shape[1]} × {rate.shape[2]} pixels are "
            f"{numbers:.2g} numbers per frame; use fewer bins or pixels, {_MOST_NUMBERS:.0e} in all"
        )
    if (later_s is None) == tcspc.from_camera:
        raise ValueError(
            f"tcspc.from_camera: {str(tcspc.from_camera).lower()}; true needs later_s, the delay "
            "of each pixel, and false has none"
        )
    pulsed = rate * tcspc.pulsed_share * tcspc.period_s
    constant = (rate * (1 - tcspc.pulsed_share) + device.dark_counts_hz) * tcspc.period_s
    if later_s is not None:
        later_s = np.broadcast_to(np.asarray(later_s, np.float64), rate.shape)
        returns = np.isfinite(later_s)
        constant = constant + np.where(returns, 0, pulsed)
        pulsed, later_s = np.where(returns, pulsed, 0), np.where(returns, later_s, 0)
    return first_photon_shares(pulsed, constant, tcspc, sensor.jitter, later_s)


def periods(sensor: Sensor) -> int:
    """Return the number of whole periods in an exposure."""
    return int(sensor.exposure_s / sensor.tcspc.period_s * (1 + 1e-9))


def expose_histograms(
    detections_hz: ArrayLike,
    sensor: Sensor,
    *,
    seed: int,
    stream: str | int,
    first_frame: int = 0,
    later_s: ArrayLike | None = None,
) -> NDArray[np.uint32]:
    """Draw histograms of photons by their time after a pulse, (T, H, W, bins).

    `detections_hz` (T, H, W): mean detection rate of always-live pixels, Hz; `tcspc` says how it is
    pulsed. `later_s` (T, H, W), with `tcspc.from_camera`: delay of each pixel's pulse after
    `tcspc.delay_s`; infinite: no pulse returns, and all light is constant. The others, and what is
    refused, as for `expose_rate`; also raises ValueError as `check_histograms`.
    """
    check_histograms(sensor)
    rate = checked_rate(detections_hz, sensor)
    device = draw_fixed_pattern(sensor, (rate.shape[-2], rate.shape[-1]))
    named = sensor_stream(stream, sensor, device.dark_counts_hz)
    counts = np.empty((*rate.shape, sensor.tcspc.bins), np.uint32)
    number = periods(sensor)
    later = None if later_s is None else np.broadcast_to(np.asarray(later_s), rate.shape)

    def expose_frame(index: int) -> None:
        later_of_frame = None if later is None else later[index : index + 1]
        shares = _shares(rate[index : index + 1], sensor, later_of_frame)[0]
        missed = np.maximum(1 - shares.sum(axis=-1, keepdims=True), 0)
        rng = generator(seed, "histograms", named, light_key(rate[index]), first_frame + index)
        drawn = rng.multinomial(number, np.concatenate((shares, missed), axis=-1))
        counts[index] = drawn[..., :-1]

    over_frames(expose_frame, range(len(rate)))
    return counts
