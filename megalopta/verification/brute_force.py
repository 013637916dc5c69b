"""A single-photon sensor by the plainest possible simulation, to hold the real one against.

    light       an integral over the exit pupil of the lens, another over wavelength
    device      every pixel draws its dark counts, breakdown and mismatch from the stated laws
    avalanches  arrival after arrival, and of the released carriers whichever comes first, found by
                looking at all of them
    counter     event after event: up by one, or a step off a voltage

Nothing is skipped and no law of the counts is used. Light that changes is thinned out of the
brightest. A closed gate drops what arrives. A stationary start is a live one a long time earlier,
long enough for dead times to lose their rhythm; frames that follow on each other are cut from one
run. Slow on purpose. It takes parameters from the sensor and shares no code with it.
"""

from collections.abc import Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.constants import c, h
from scipy.integrate import dblquad, quad

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled
from megalopta.sensor import AnalogCounter, Crosstalk, Sensor
from megalopta.sensor.effects.fields import AvalancheEffects

Counts = NDArray[np.int64]
_DEAD_TIMES_TO_FORGET = 300


class PlainPixels(NamedTuple):
    """What pixels are, each (arrays, pixels of an array); rates in Hz, the others are factors."""

    efficiency: Floats
    dark_hz: Floats
    dead_time: Floats
    afterpulsing: Floats
    crosstalk: Floats
    layout: tuple[int, int] = (1, 1)
    """Rows and columns of an array"""

    @classmethod
    def alike(cls, shape: tuple[int, int]) -> "PlainPixels":
        """Pixels as the fields of a sensor say, without dark counts."""
        one = np.ones(shape)
        return cls(one, np.zeros(shape), one, one, one)


class _Arrays(NamedTuple):
    rates: Floats
    """Hz, (arrays, parts, pixels)"""
    dead_times: Floats
    carriers: Floats
    strengths: Floats
    chances: Floats
    """That an avalanche of the first pixel fires the second"""


class _Rules(NamedTuple):
    exposure: float
    run_up: float
    extends: bool
    twilight: float
    recharge: float
    gate: tuple[float, float, float]
    delay: float
    delays: Floats
    cumulative: Floats


def brute_force_counts(
    rng: np.random.Generator,
    rate_hz: float,
    exposure_s: float,
    effects: AvalancheEffects | Sensor,
    exposures: int,
) -> Counts:
    """Return the events (exposures,) of one pixel that knows of no other."""
    rates = np.full((exposures, 1, 1), rate_hz)
    return brute_force_events(rng, rates, exposure_s, effects).ravel()


def brute_force_events(
    rng: np.random.Generator,
    rates_hz: Floats,
    exposure_s: float,
    effects: AvalancheEffects | Sensor,
    pixels: PlainPixels | None = None,
    frames: int = 1,
) -> Counts:
    """Events of arrays of pixels, (arrays, frames, pixels).

    Parameters
    ----------
    rates_hz : (arrays, S, pixels) float64
        Arrivals per second, constant or in S equal parts of an exposure.
    pixels : PlainPixels, optional
        Factors on what the effects say; its efficiency and dark counts are not used.
    frames : int
        How many exposures follow on each other without a new start.
    """
    arrays, _, size = rates_hz.shape
    pixels = pixels or PlainPixels.alike((arrays, size))
    dead, traps = effects.dead_time, effects.afterpulsing
    tau = dead.dead_time_s * (dead.kind != "ideal")
    rules = _Rules(
        exposure_s,
        run_up_s(effects),
        dead.kind == "paralyzable",
        dead.twilight_s,
        dead.recharge_s,
        (effects.gate.period_s or 0.0, effects.gate.width_s or 0.0, effects.gate.phase_s),
        traps.delay_s,
        np.array(traps.table_delays_s, np.float64),
        np.array(traps.table_cumulative, np.float64),
    )
    made = tau * pixels.dead_time, traps.mean_carriers * pixels.afterpulsing, pixels.crosstalk
    counts = np.zeros((arrays, frames, size), np.int64)
    light = np.ascontiguousarray(rates_hz, np.float64)
    chances = _chances(effects.crosstalk, *pixels.layout)
    _simulate(rng, _Arrays(light, *made, chances), rules, counts)
    return counts


def run_up_s(effects: AvalancheEffects | Sensor) -> float:
    """Time simulated before the exposure, s."""
    dead, traps = effects.dead_time, effects.afterpulsing
    if dead.start == "live":
        return 0.0
    longest = traps.table_delays_s[-1] if traps.table_delays_s else traps.delay_s
    forgotten = 20 * longest / (1 - traps.mean_carriers) * (traps.mean_carriers > 0)
    return _DEAD_TIMES_TO_FORGET * (dead.dead_time_s + dead.recharge_s) + forgotten


def _chances(talk: Crosstalk, rows: int, columns: int) -> Floats:
    y, x = np.indices((rows, columns)).reshape(2, -1)
    squared = (y[:, None] - y) ** 2 + (x[:, None] - x) ** 2
    straight = (y[:, None] == y) | (x[:, None] == x)
    shares = [1.0, talk.diagonal, talk.distance_two, talk.distance_three]
    relative = np.select(
        [squared == 1, squared == 2, straight & (squared == 4), straight & (squared == 9)], shares
    )
    return np.asarray(talk.mean_fired_neighbors * relative / (4 * sum(shares)))


@compiled
def _simulate(rng, arrays, rules, counts):  # type: ignore[no-untyped-def]
    for array in range(counts.shape[0]):
        rates = arrays.rates[array]
        brightest = np.array([rates[:, pixel].max() for pixel in range(rates.shape[1])])
        arrivals = np.array([_pause(rng, each) for each in brightest]) - rules.run_up
        blind_until = np.full(brightest.size, -np.inf)
        waiting = [(np.inf, 0)]  # carriers, and arrivals in the twilight of a dead time
        while True:
            pixel = int(arrivals.argmin())
            now, is_new = arrivals[pixel], True
            first = _earliest(waiting)
            if waiting[first][0] < now:
                now, pixel = waiting.pop(first)
                is_new = False
            if now >= rules.exposure * counts.shape[1]:
                break
            if is_new:
                arrivals[pixel] += _pause(rng, brightest[pixel])
                rate = rates[_part(now, rules.exposure, rates.shape[0]), pixel]
                if rng.random() * brightest[pixel] >= rate:
                    continue
            period, width, phase = rules.gate
            if period == 0 or (now - phase) % period < width:
                _strike(rng, (arrays, rules), (array, now, pixel), blind_until, waiting, counts)


@compiled
def _strike(rng, device, arrival, blind_until, waiting, counts):  # type: ignore[no-untyped-def]
    """All that happens at once: the pixel, and those that it fires by its light."""
    arrays, rules = device
    array, now, first = arrival
    struck = [first]
    while len(struck) > 0:
        pixel = struck.pop()
        since, tau = now - blind_until[pixel], arrays.dead_times[array, pixel]
        if since < 0:
            if rules.extends:
                blind_until[pixel] = now + tau
            elif -since <= rules.twilight:
                waiting.append((blind_until[pixel], pixel))
            continue
        if rules.recharge > 0 and rng.random() < np.exp(-since / rules.recharge):
            continue
        blind_until[pixel] = now + tau
        if now >= 0:
            counts[array, int(now / rules.exposure), pixel] += 1
        if arrays.carriers[array, pixel] > 0:
            for _ in range(rng.poisson(arrays.carriers[array, pixel])):
                waiting.append((now + _delay(rng, rules), pixel))
        for other in range(blind_until.size):
            if rng.random() < arrays.chances[pixel, other] * arrays.strengths[array, pixel]:
                struck.append(other)


@compiled
def _earliest(waiting):  # type: ignore[no-untyped-def]
    first = 0
    for place in range(1, len(waiting)):
        if waiting[place][0] < waiting[first][0]:
            first = place
    return first


@compiled
def _pause(rng, rate):  # type: ignore[no-untyped-def]
    return rng.exponential(1 / rate) if rate > 0 else np.inf


@compiled
def _part(now, exposure, parts):  # type: ignore[no-untyped-def]
    return min(int((now % exposure) / exposure * parts), parts - 1) if now > 0 else 0


@compiled
def _delay(rng, rules):  # type: ignore[no-untyped-def]
    if rules.delays.size > 0:
        return np.interp(rng.random(), rules.cumulative, rules.delays)
    return rng.exponential(rules.delay)


def plain_light_hz(radiance: float, band_nm: tuple[float, float], sensor: Any) -> float:
    """Detections per second of a pixel on the axis, in a flat spectrum over one band."""
    lens, passing = sensor.lens, sensor.lens.transmission_curve
    points = {*sensor.efficiency.wavelengths_nm, *(passing.wavelengths_nm if passing else ())}

    def per_watt(nm: float) -> float:
        passed = np.interp(nm, passing.wavelengths_nm, passing.values) if passing else 1.0
        seen = np.interp(nm, sensor.efficiency.wavelengths_nm, sensor.efficiency.values)
        return float(seen * passed * nm * 1e-9 / (h * c))

    edges = [band_nm[0], *sorted(nm for nm in points if band_nm[0] < nm < band_nm[1]), band_nm[1]]
    each = [quad(per_watt, *pair)[0] for pair in pairwise(edges)]
    light = radiance * lens.transmission * seen_pupil(lens.f_number)
    return float(light * sum(each) * sensor.pitch_m**2 * sensor.fill_factor)


def seen_pupil(f_number: float, x: float = 0.0, y: float = 0.0) -> float:
    """Irradiance per radiance, sr, at a point (focal lengths) of the die.

    The pupil is a disc of diameter f/N at the distance f, every point of it as bright as the scene.
    A piece dA of it at p adds cos²θ·dA/|p − s|², cos θ = f/|p − s|, at the point s of the die.
    """
    seen, _ = dblquad(
        lambda r, phi: r / (1 + (r * np.cos(phi) - x) ** 2 + (r * np.sin(phi) - y) ** 2) ** 2,
        *(0, 2 * np.pi, 0, 1 / (2 * f_number)),
    )
    return float(seen)


def plain_pixels(
    rng: np.random.Generator,
    sensor: Sensor,
    shape: tuple[int, int],
    measured: Mapping[str, Floats] | None = None,
) -> PlainPixels:
    """Draw pixels, each of a device of its own; `measured` (shape) takes the place of a drawing."""
    maps, bias, heat = measured or {}, sensor.bias, sensor.temperature
    rise = heat.celsius - heat.reference_celsius
    offset = maps.get("breakdown", bias.breakdown_sigma_v * rng.standard_normal(shape))
    now = bias.excess_v - offset - heat.breakdown_v_per_k * rise
    live = now > bias.onset_v

    def change(name: str, law: Any) -> Floats:
        """What was measured at the reference bias has the offset of each pixel in it."""
        return np.asarray(law(now) / law(bias.reference_v - offset * (name in maps)))

    efficiency = maps.get("efficiency", np.ones(shape)) * live
    if bias.efficiency_scale_v:
        scale_v, onset = bias.efficiency_scale_v, bias.onset_v
        efficiency *= change("efficiency", lambda volts: 1 - np.exp((onset - volts) / scale_v))
    dark = maps.get("dark_counts", _drawn_dark_hz(rng, sensor, shape)) * live
    dark *= 2 ** (rise / heat.dcr_doubling_k)
    if bias.dark_efold_v:
        dark *= change("dark_counts", lambda volts: np.exp(volts / bias.dark_efold_v))
    factors = []
    for name, slope in (
        ("dead_time", 0.0),
        ("afterpulsing", bias.afterpulsing_slope),
        ("crosstalk", bias.crosstalk_slope),
    ):
        factor = maps.get(name, _log_normal(rng, 1.0, getattr(sensor, name).mismatch_sigma, shape))
        charge = np.maximum(1 + slope * (now / bias.reference_v - 1), 0.0)
        factors.append(factor * charge)
    return PlainPixels(efficiency, dark, factors[0], factors[1], factors[2])


def _drawn_dark_hz(rng: np.random.Generator, sensor: Sensor, shape: tuple[int, int]) -> Floats:
    dark = sensor.dark_counts
    ordinary = rng.normal(dark.bulk_mean_hz_um2, dark.bulk_sigma_hz_um2, shape)
    while (ordinary < 0).any():  # none is negative
        again = ordinary < 0
        ordinary[again] = rng.normal(dark.bulk_mean_hz_um2, dark.bulk_sigma_hz_um2, again.sum())
    hot = _log_normal(rng, dark.hot_mean_hz_um2, dark.hot_sigma_hz_um2, shape)
    density = np.where(rng.random(shape) < dark.hot_fraction, hot, ordinary)
    return np.asarray(density * (sensor.pitch_m * 1e6) ** 2 * sensor.fill_factor)


def _log_normal(
    rng: np.random.Generator, mean: float, sigma: float, shape: tuple[int, int]
) -> Floats:
    if sigma == 0:
        return np.full(shape, mean)
    width = np.log(1 + (sigma / mean) ** 2) ** 0.5
    return np.asarray(rng.lognormal(np.log(mean) - width**2 / 2, width, shape))


def plain_readings(
    rng: np.random.Generator, events: Counts, sensor: Sensor
) -> tuple[Floats, NDArray[np.bool_]]:
    """Readings, and which are flagged as perhaps too low, of events; each of a pixel of its own."""
    if isinstance(sensor.counter, AnalogCounter):
        return _analog_readings(rng, events, sensor.counter, sensor.exposure_s)
    capacity, wraps = sensor.counter.capacity, sensor.counter.overflow == "wrap"
    readings = np.array([_counted(n, capacity, wraps) for n in events.ravel()]).reshape(
        events.shape
    )
    return readings.astype(np.float64), events >= capacity + wraps


@compiled
def _counted(events: int, capacity: int, wraps: bool) -> int:
    reading = 0
    for _ in range(events):
        if reading < capacity:
            reading += 1
        elif wraps:
            reading = 0
    return reading


def _analog_readings(
    rng: np.random.Generator, events: Counts, counter: AnalogCounter, exposure_s: float
) -> tuple[Floats, NDArray[np.bool_]]:
    def drawn(mean: float, sigma: float) -> Floats:
        return np.asarray(mean + sigma * rng.standard_normal(events.shape))

    step = drawn(counter.step_v, counter.step_sigma_v)
    leak = exposure_s * drawn(counter.leak_v_s, counter.leak_sigma_v_s)
    offset = drawn(0.0, counter.offset_sigma_v)
    fallen = np.zeros(events.shape)
    for number in range(int(events.max(initial=0))):
        shrunk = step * (1 + counter.step_slope * (0.5 - fallen / counter.swing_v))
        fallen += np.where(number < events, shrunk, 0.0)
    fallen += drawn(0.0, counter.step_noise_v) * np.sqrt(events) + leak
    volts = counter.supply_v + offset - np.minimum(fallen, counter.swing_v)
    volts += drawn(0.0, counter.read_noise_v)
    if counter.adc_bits is not None:
        code_v = counter.supply_v / (2**counter.adc_bits - 1)
        volts = np.clip(np.rint(volts / code_v) * code_v, 0.0, counter.supply_v)
    if not counter.calibrated:
        step, leak = np.array(counter.step_v), np.array(counter.leak_v_s * exposure_s)
        offset = np.zeros(1)
    counts = np.maximum(np.rint((counter.supply_v + offset - leak - volts) / step), 0.0)
    largest = np.floor((counter.swing_v - leak) / step + 1e-9)
    return np.minimum(counts, largest), (fallen > counter.swing_v) | (counts >= largest)
