"""A sensor by the plainest possible simulation, as a reference for the real one.

    light       an integral over the exit pupil of the lens, another over wavelength
    device      every pixel draws its dark counts, breakdown and mismatch as the sensor states
    avalanches  arrival after arrival, with the earliest of all released carriers, found by
    checking all of them
    counter     event after event: up by one, or a voltage step
    CTIA        electrons in both directions, in short steps, onto a capacitor

Nothing is skipped and no distribution of counts is used. Changing light is thinned from the
brightest. A closed gate drops arrivals. A stationary start is a live start long before the
exposure, so that dead times lose their phase; consecutive frames are cut from one run. It is slow
by design: it takes parameters from the sensor and shares no code with it.
"""

from typing import NamedTuple

import numpy as np
from scipy.constants import c, e, h, k
from scipy.integrate import dblquad, trapezoid

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled
from megalopta.sensor import AnalogCounter, DacBias, FixedBias, Sensor
from megalopta.sensor.shot import NextFrames

_DEAD_TIMES_TO_FORGET = 300
_STEPS = 200


class PlainPixels(NamedTuple):
    """Random pixels, each (arrays, pixels of an array); rates in Hz, the others are factors."""

    efficiency: Floats
    dark_hz: Floats
    dead_time: Floats
    afterpulsing: Floats
    crosstalk: Floats


class _Device(NamedTuple):
    dead_times: Floats
    carriers: Floats
    strengths: Floats
    """Each (arrays, pixels)"""
    chances: Floats
    """Probability that an avalanche of the first pixel fires the second"""
    exposure: float
    bins: int
    run_up: float
    extends: bool
    twilight: float
    recharge: float
    jitter: tuple[float, float, float]
    """Standard deviation; share and mean of the tail"""
    gate: tuple[float, float, float]
    delay: float
    delays: Floats
    cumulative: Floats


def brute_force_events(
    rng, rates_hz, exposure_s, effects, pixels=None, layout=None, frames=1, bins=1
):
    """Return the events of arrays of pixels, (arrays, frames · bins, pixels).

    Parameters
    ----------
    rates_hz : (arrays, S, pixels) float64
        Arrivals per second, constant or in S equal parts of an exposure.
    effects : AvalancheEffects or Sensor
    pixels : PlainPixels, optional
        Factors on the effects' parameters; its efficiency and dark counts are not used.
    layout : (int, int)
        Rows and columns of an array; default: a row of pixels.
    frames : int
        Number of consecutive exposures without a reset.
    bins : int
        Equal parts of an exposure whose events are told apart.
    """
    arrays, _, size = rates_hz.shape
    pixels = pixels or PlainPixels(*np.ones((5, arrays, size)))
    dead, traps, gate = effects.dead_time, effects.afterpulsing, effects.gate
    device = _Device(
        dead.dead_time_s * (dead.kind != "ideal") * pixels.dead_time,
        traps.mean_carriers * pixels.afterpulsing,
        pixels.crosstalk,
        chances(effects.crosstalk, *(layout or (1, size))),
        exposure_s,
        bins,
        _run_up_s(effects),
        dead.kind == "paralyzable",
        dead.twilight_s,
        dead.recharge_s,
        _jitter(effects),
        (gate.period_s or 0.0, gate.width_s or 0.0, gate.phase_s),
        traps.delay_s,
        np.array(traps.table_delays_s, np.float64),
        np.array(traps.table_cumulative, np.float64),
    )
    counts = np.zeros((arrays, frames * bins, size), np.int64)
    _simulate(rng, np.ascontiguousarray(rates_hz, np.float64), device, counts)
    return counts


def _jitter(effects):
    if not isinstance(effects, Sensor) or not effects.jitter.is_on:
        return 0.0, 0.0, 0.0
    jitter = effects.jitter
    return jitter.sigma_s, jitter.tail_share * (jitter.tail_s > 0), jitter.tail_s


def _run_up_s(effects):
    """Time simulated before the exposure, s."""
    dead, traps = effects.dead_time, effects.afterpulsing
    if dead.start == "live":
        return 0.0
    longest = traps.table_delays_s[-1] if traps.table_delays_s else traps.delay_s
    forgotten = 20 * longest / (1 - traps.mean_carriers) * (traps.mean_carriers > 0)
    return _DEAD_TIMES_TO_FORGET * (dead.dead_time_s + dead.recharge_s) + forgotten


def chances(talk, rows, columns):
    """Return the probability that an avalanche of a pixel (row) fires another (column)."""
    y, x = np.indices((rows, columns)).reshape(2, -1)
    if talk.kernel:
        weights = np.array(talk.kernel)
        down, right = y - y[:, None] + weights.shape[2] // 2, x - x[:, None] + weights.shape[3] // 2
        inside = (down >= 0) & (right >= 0)
        inside &= (down < weights.shape[2]) & (right < weights.shape[3])
        places = y[:, None] % weights.shape[0], x[:, None] % weights.shape[1]
        relative = np.where(inside, weights[(*places, down * inside, right * inside)], 0.0)
        mean_weight = weights.sum(axis=(2, 3)).mean()
        return talk.mean_fired_neighbors * relative / mean_weight
    squared = (y[:, None] - y) ** 2 + (x[:, None] - x) ** 2
    straight = (y[:, None] == y) | (x[:, None] == x)
    shares = [1.0, talk.diagonal, talk.distance_two, talk.distance_three]
    relative = np.select(
        [squared == 1, squared == 2, straight & (squared == 4), straight & (squared == 9)], shares
    )
    return talk.mean_fired_neighbors * relative / (4 * sum(shares))


@compiled
def _simulate(rng, light, device, counts):
    for array in range(counts.shape[0]):
        rates = light[array]
        brightest = np.array([rates[:, pixel].max() for pixel in range(rates.shape[1])])
        arrivals = np.array([_pause(rng, rate) for rate in brightest]) - device.run_up
        dead_until = np.full(brightest.size, -np.inf)
        waiting = [(np.inf, 0)]  # carriers, and arrivals in the twilight of a dead time
        while True:
            pixel = int(arrivals.argmin())
            now, is_new = arrivals[pixel], True
            first = _earliest(waiting)
            if waiting[first][0] < now:
                now, pixel = waiting.pop(first)
                is_new = False
            if now >= device.exposure / device.bins * counts.shape[1]:
                break
            if is_new:
                arrivals[pixel] += _pause(rng, brightest[pixel])
                rate = rates[_part(now, device.exposure, rates.shape[0]), pixel]
                if rng.random() * brightest[pixel] >= rate:
                    continue
            period, width, phase = device.gate
            if period == 0 or (now - phase) % period < width:
                _strike(rng, device, (array, now, pixel), dead_until, waiting, counts[array])


@compiled
def _strike(rng, device, arrival, dead_until, waiting, counts):
    """Process an avalanche: of the pixel, and of those fired by crosstalk."""
    array, now, first = arrival
    struck = [first]
    while len(struck) > 0:
        pixel = struck.pop()
        since, tau = now - dead_until[pixel], device.dead_times[array, pixel]
        if since < 0:
            if device.extends:
                dead_until[pixel] = now + tau
            elif -since <= device.twilight:
                waiting.append((dead_until[pixel], pixel))
            continue
        if device.recharge > 0 and rng.random() < np.exp(-since / device.recharge):
            continue
        dead_until[pixel] = now + tau
        if now >= 0:
            counts[_frame(rng, device, now, len(counts)), pixel] += 1
        if device.carriers[array, pixel] > 0:
            for _ in range(rng.poisson(device.carriers[array, pixel])):
                waiting.append((now + _delay(rng, device), pixel))
        for neighbor in range(dead_until.size):
            if rng.random() < device.chances[pixel, neighbor] * device.strengths[array, pixel]:
                struck.append(neighbor)


@compiled
def _frame(rng, device, now, frames):
    sigma, share, tail = device.jitter
    stamp = now + sigma * rng.standard_normal() if sigma > 0 else now
    if share > 0 and rng.random() < share:
        stamp += _pause(rng, 1 / tail)
    return min(max(int(stamp / device.exposure * device.bins), 0), frames - 1)


@compiled
def _earliest(waiting):
    first = 0
    for place in range(1, len(waiting)):
        if waiting[place][0] < waiting[first][0]:
            first = place
    return first


@compiled
def _pause(rng, rate):
    return rng.exponential(1 / rate) if rate > 0 else np.inf


@compiled
def _part(now, exposure, parts):
    return min(int((now % exposure) / exposure * parts), parts - 1) if now > 0 else 0


@compiled
def _delay(rng, device):
    if device.delays.size > 0:
        return np.interp(rng.random(), device.cumulative, device.delays)
    return rng.exponential(device.delay)


def plain_light_hz(radiance, band_nm, sensor):
    """Detections per second of a pixel on the axis, in a flat spectrum over one band."""
    lens, passing = sensor.lens, sensor.lens.transmission_curve
    meters = 1e-9 * (nm := np.linspace(*band_nm, 100_001))
    passed = np.interp(nm, passing.wavelengths_nm, passing.values) if passing else 1.0
    seen = np.interp(nm, sensor.efficiency.wavelengths_nm, sensor.efficiency.values)
    per_watt = trapezoid(seen * passed * meters / (h * c), nm)
    light = radiance * lens.transmission * _seen_pupil(lens.f_number)
    return float(light * per_watt * sensor.pitch_m**2 * sensor.fill_factor)


def plain_falloff(lens, rows, columns):
    """Light in the pixels of an array (rows · columns,) relative to that on the axis."""
    pixel = 2 * np.tan(np.radians((lens.falloff_fov_deg or 0.0) / 2)) / columns
    y, x = np.indices((rows, columns)).reshape(2, -1) - np.array([[rows - 1], [columns - 1]]) / 2
    seen = [_seen_pupil(lens.f_number, *place) for place in zip(x * pixel, y * pixel, strict=True)]
    return np.array(seen) / _seen_pupil(lens.f_number)


def _seen_pupil(f_number, x=0.0, y=0.0):
    """Irradiance per radiance, sr, at a point (focal lengths) of the die.

    The pupil is a disc of diameter f/N at the distance f, uniformly as bright as the scene. A piece
    dA of it at p adds cos²θ·dA/|p − s|², cos θ = f/|p − s|, at the point s of the die.
    """
    seen, _ = dblquad(
        lambda r, phi: r / (1 + (r * np.cos(phi) - x) ** 2 + (r * np.sin(phi) - y) ** 2) ** 2,
        *(0, 2 * np.pi, 0, 1 / (2 * f_number)),
    )
    return float(seen)


def plain_pixels(rng, sensor, shape, measured=None):
    """Draw pixels, each of its own device; `measured` (shape) replaces a draw."""
    maps, bias, heat = measured or {}, sensor.bias, sensor.temperature
    rise = heat.celsius - heat.reference_celsius
    offset = maps.get("breakdown", bias.breakdown_sigma_v * rng.standard_normal(shape))
    now = bias.excess_v - offset - heat.breakdown_v_per_k * rise
    live = now > bias.onset_v

    def change(name, law):
        """Values measured at the reference bias include the offset of each pixel."""
        return law(now) / law(bias.reference_v - offset * (name in maps))

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


def _drawn_dark_hz(rng, sensor, shape):
    dark = sensor.dark_counts
    ordinary = rng.normal(dark.bulk_mean_hz_um2, dark.bulk_sigma_hz_um2, shape)
    while (ordinary < 0).any():  # none is negative
        again = ordinary < 0
        ordinary[again] = rng.normal(dark.bulk_mean_hz_um2, dark.bulk_sigma_hz_um2, again.sum())
    hot = _log_normal(rng, dark.hot_mean_hz_um2, dark.hot_sigma_hz_um2, shape)
    density = np.where(rng.random(shape) < dark.hot_fraction, hot, ordinary)
    return density * (sensor.pitch_m * 1e6) ** 2 * sensor.fill_factor


def _log_normal(rng, mean, sigma, shape):
    if sigma == 0:
        return np.full(shape, mean)
    width = np.log(1 + (sigma / mean) ** 2) ** 0.5
    return rng.lognormal(np.log(mean) - width**2 / 2, width, shape)


def plain_readings(rng, events, sensor):
    """Return readings of events, each of its own pixel, and flags of possible lower bounds."""
    if isinstance(sensor.counter, AnalogCounter):
        return _analog_readings(rng, events, sensor.counter, sensor.exposure_s)
    capacity, wraps = sensor.counter.capacity, sensor.counter.overflow == "wrap"
    readings = events % (capacity + 1) if wraps else np.minimum(events, capacity)
    return readings.astype(np.float64), events >= capacity + wraps


def _analog_readings(rng, events, counter, exposure_s):
    def drawn(mean, sigma):
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


def plain_volts(rng, sensor, light_a, frame):
    """Discharge, V, and its saturation at the swing, of CTIA pixels of any shape at a frame.

    Each belongs to its own device and gets its electrons in short steps: those of the light, and
    those that cross its diode in both directions.
    """
    diode, noise, normal = sensor.diode, sensor.noise, rng.standard_normal
    step_s, shape = sensor.exposure_s / _STEPS, light_a.shape
    gain = 10 ** ((sensor.gain_db + sensor.gain_sigma_db * normal(shape)) / 20)
    leak_v_s = getattr(sensor.bias, "leak_v_s", 0.0)
    bias = _trimmed(sensor, sensor.offset_v + sensor.offset_sigma_v * normal(shape))
    bias += leak_v_s * frame * sensor.exposure_s
    size = _log_normal(rng, 1.0, sensor.dark_sigma, shape)
    shunt_s = size / diode.shunt_ohm if diode.shunt_ohm else 0 * size

    def charge(current_a, is_noisy):
        electrons = current_a * step_s / e
        return np.asarray(e * (rng.poisson(electrons) if is_noisy else electrons))

    volts, rise = np.zeros(shape), np.zeros(shape)
    for step in range(_STEPS):
        # in the middle of the step
        now = bias + leak_v_s * (step + 0.5) * step_s + (volts + rise / 2) / gain
        reverse = size * diode.saturation_current_a
        forward = reverse * np.exp(-now * e / (k * diode.temperature_k))
        rise = charge(light_a, noise.photon_shot) + charge(reverse, noise.dark_shot)
        rise += shunt_s * now * step_s - charge(forward, noise.dark_shot)
        thermal = 2 * k * diode.temperature_k * shunt_s * step_s * noise.dark_shot
        rise += np.sqrt(thermal) * normal(shape)
        rise /= sensor.capacitance_f
        volts += rise
    full = volts >= sensor.swing_v
    volts += noise.read_noise_v * normal(shape)
    volts += (noise.reset * k * diode.temperature_k / sensor.capacitance_f) ** 0.5 * normal(shape)
    full |= volts >= sensor.swing_v
    return np.where(full, sensor.swing_v, volts), full


def _trimmed(sensor, offset_v):
    """Reverse bias, V: one code or pulse after the other, until the next would be one too many."""
    way = sensor.bias
    if isinstance(way, FixedBias):
        return offset_v + way.reverse_bias_v
    if isinstance(way, DacBias):
        bias, step_v = offset_v + way.reference_v, way.rail_v / 2**way.bits
    else:
        bias, step_v = offset_v + way.erased_v, way.pulse_rate_v_s * way.pulse_s
    while (above := bias - step_v >= way.target_v).any():
        bias -= step_v * above
    return bias


def sub_frames(frames, flow, parts, hidden=None):
    """Light (T − 1, parts, H, W) of frames (T, H, W) in the middle of each part of a frame."""
    hidden = np.zeros(flow.shape[:3], np.bool_) if hidden is None else hidden
    following = NextFrames(radiance=frames[1:, ..., None], flow=flow, hidden=hidden)
    middles = (np.arange(parts) + 0.5) / parts
    pairs = range(len(flow))
    return np.stack([following.between(frames[..., None], n, middles)[..., 0] for n in pairs])
