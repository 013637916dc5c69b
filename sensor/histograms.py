"""Histograms of photons by their time after a pulse, per pixel and frame (`effects.timing`)."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from megalopta.core.arrays import Floats, Ints
from megalopta.sensor.effects.base import AvalancheMaps
from megalopta.sensor.effects.timing import first_photon_shares, sorted_in_time, stamp
from megalopta.sensor.optics import checked_rate
from megalopta.sensor.sampling.streams import generator, light_key, over_frames, sensor_stream
from megalopta.sensor.spad.array import MOST_STORED
from megalopta.sensor.spad.counts import check_load
from megalopta.sensor.spad.device import draw_fixed_pattern
from megalopta.sensor.spad.model import AvalancheEffects, Sensor
from megalopta.sensor.spad.simulation import simulate_frame

_MOST_NUMBERS = 1e8
"""Most bins of all pixels of a frame, drawn in some 20 s"""
_MOST_WRAPPED = 100
"""Most periods that a standard deviation or a decay lasts"""


def check_histograms(sensor: Sensor) -> None:
    """Raise ValueError if a sensor has no histograms."""
    tcspc = sensor.tcspc
    if not tcspc.is_on:
        raise ValueError(
            f"tcspc.bins: 0 in sensor {sensor.name!r}; give the bins of a period for histograms"
        )
    period_s = tcspc.period_s
    wrapped_s, shorter = _MOST_WRAPPED * period_s, f"or give {_MOST_WRAPPED} longer periods"
    for field, time_s, most_s, remedy in (
        ("tcspc.period_s", period_s, sensor.exposure_s, "or expose for many periods"),
        ("exposure_s", sensor.exposure_s, 4e9 * period_s, "more periods overflow counts"),
        ("tcspc.pulse_sigma_s", tcspc.pulse_sigma_s, wrapped_s, shorter),
        ("tcspc.decay_s", tcspc.decay_s, wrapped_s, shorter),
        ("jitter.sigma_s", sensor.jitter.sigma_s, wrapped_s, shorter),
        ("jitter.tail_s", sensor.jitter.tail_s, wrapped_s, shorter),
    ):
        if time_s > most_s:
            raise ValueError(f"{field}: {time_s:g}; give at most {most_s:g} s: {remedy}")
    for field, share in (
        ("telegraph.share", sensor.telegraph.share),
        ("lag_share", sensor.lag_share),
    ):
        if share:
            raise ValueError(f"{field}: {share:g}; histograms have none of it: give 0")


def is_ready(sensor: Sensor) -> bool:
    """True if pixels are ready at every pulse, and fired by light and dark counts alone."""
    windows = sensor.tcspc.period_s / (sensor.gate.period_s or sensor.tcspc.period_s)
    repeats = windows > 0.5 and abs(windows - round(windows)) < 1e-9
    recovers = sensor.dead_time.dead_time_s <= sensor.tcspc.period_s
    return repeats and recovers and sensor.avalanche_effects.on <= {"gate", "dead_time"}


def mean_histograms(
    detections_hz: ArrayLike, sensor: Sensor, later_s: ArrayLike | None = None
) -> Floats:
    """Return the mean counts in each bin, (T, H, W, bins); of n periods, variance m·(1 − m/n).

    Parameters as for `expose_histograms`. Raises ValueError as this does, or unless `is_ready`.
    """
    if not is_ready(sensor):
        raise ValueError(
            f"sensor {sensor.name!r}: no mean is stated with afterpulses, crosstalk, a dead time "
            "above tcspc.period_s or a gate of another period; average expose_histograms"
        )
    light = _arrivals(detections_hz, sensor, later_s)[1:]
    shares = first_photon_shares(*light, sensor.tcspc, sensor.jitter, sensor.gate)
    return periods(sensor) * shares


def _arrivals(
    detections_hz: ArrayLike, sensor: Sensor, later_s: ArrayLike | None
) -> tuple[Floats, Floats, Floats, Floats | None]:
    """Rates, Hz; mean arrivals per period from pulses, and of others; delays; each (T, H, W)."""
    check_histograms(sensor)
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
    return rate, pulsed, constant, later_s


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
    rate, pulsed, constant, later = _arrivals(detections_hz, sensor, later_s)
    device = draw_fixed_pattern(sensor, (rate.shape[-2], rate.shape[-1]))
    named = sensor_stream(stream, sensor, device.dark_counts_hz)
    counts = np.empty((*rate.shape, sensor.tcspc.bins), np.uint32)

    def expose_frame(index: int) -> None:
        light = pulsed[index], constant[index], None if later is None else later[index]
        rng = generator(seed, "histograms", named, light_key(rate[index]), first_frame + index)
        if not is_ready(sensor):
            counts[index] = _followed(rng, sensor, device.avalanches, light)
            return
        shares = first_photon_shares(*light, sensor.tcspc, sensor.jitter, sensor.gate)
        missed = np.maximum(1 - shares.sum(axis=-1, keepdims=True), 0)
        drawn = rng.multinomial(periods(sensor), np.concatenate((shares, missed), axis=-1))
        counts[index] = drawn[..., :-1]

    over_frames(expose_frame, range(len(rate)))
    return counts


def _followed(
    rng: np.random.Generator, sensor: Sensor, maps: AvalancheMaps | None, light: Any
) -> Ints:
    """Draw the histograms (H, W, bins) of a frame of `_arrivals` avalanche by avalanche."""
    pulsed, constant, later_s = light
    tcspc, dead, effects = sensor.tcspc, sensor.dead_time, sensor.avalanche_effects
    period_s, arrivals = tcspc.period_s, pulsed + constant
    memory_s = (effects.memory_s + 20 * dead.dead_time_s) * (dead.start == "stationary")
    before = int(np.ceil(memory_s / period_s))
    pulses = before + periods(sensor)
    check_load(arrivals / period_s, pulses * period_s, AvalancheEffects(), None, MOST_STORED)
    lit, dark = (
        np.repeat(np.arange(mean.size), rng.poisson(mean.ravel() * pulses))
        for mean in (pulsed, constant)
    )
    times_s = np.concatenate((np.full(lit.size, tcspc.delay_s), period_s * rng.random(dark.size)))
    times_s[: lit.size] += 0.0 if later_s is None else later_s.ravel()[lit]
    times_s[: lit.size] += tcspc.pulse_sigma_s * rng.standard_normal(lit.size)
    times_s[: lit.size] += tcspc.decay_s * rng.standard_exponential(lit.size)
    times_s += period_s * rng.integers(pulses, size=times_s.size)
    times_s = times_s % (pulses * period_s) - before * period_s  # pulses before were like these
    window_s, width_s, phase_s = sensor.gate.window
    met = np.flatnonzero((times_s - phase_s) % window_s < width_s if window_s else times_s < np.inf)
    met = met[np.argsort(times_s[met])]
    photons = times_s[met], np.concatenate((lit, dark))[met]
    exposure_s = periods(sensor) * period_s
    fired = simulate_frame(rng, 0 * arrivals, exposure_s, effects, maps=maps, arrivals=photons)
    late_s = stamp(rng, fired.times_s, sensor.jitter) - fired.times_s
    histograms = sorted_in_time(fired.times_s, fired.pixels, arrivals.size, tcspc, late_s)
    return histograms.reshape(*arrivals.shape, tcspc.bins)
