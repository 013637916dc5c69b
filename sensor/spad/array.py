"""One exposure of a SPAD array, step by step in physical order.

    optics        radiance → photons per second detected by an always-live pixel (`optics`)
    device        × relative efficiency; dark counts of each pixel (`spad.device`)
    arrivals      detected photons + dark carriers, whose rate may switch (telegraph noise)
    avalanches    arrivals that fire: gate, dead time, afterpulses, crosstalk
    readout       counts, codes of an ADC, bits, or the time of every event

Light is constant during an exposure, or (T, S, H, W) in S equal parts of it (`shot`). An exposure
of a sum (`counter.sums`) has the light of the part in which it begins; that of several, their mean.

Every frame has its own random streams, named by seed, stream, sensor, light and frame number. A
frame's draws thus depend neither on other frames drawn with it, nor on the number of threads.
Exposures that differ in any of these are independent; equal ones give equal readings. Counts,
events and bits are drawn from different streams: they agree in distribution, not count by count.
For an array with memory that is not reset between frames, they are drawn avalanche by avalanche
from the same streams, and are the same events.
"""

import math
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from megalopta.core.arrays import Floats, Ints
from megalopta.sensor import optics, quantities
from megalopta.sensor.change import changed
from megalopta.sensor.effects import crosstalk, dark_counts, dead_time, timing
from megalopta.sensor.effects.base import AvalancheMaps
from megalopta.sensor.effects.gating import open_fraction
from megalopta.sensor.sampling import poisson, streams
from megalopta.sensor.spad import counters, counts, moments
from megalopta.sensor.spad.device import draw_fixed_pattern
from megalopta.sensor.spad.model import Sensor
from megalopta.sensor.spad.simulation import PixelState, simulate_frame

MOST_STORED = 5e7
"""Most events of a frame whose times are kept: about 3 GB while drawn and sorted."""
Reading: TypeAlias = Literal["counts", "codes", "bits", "events"]


class ArrayState(NamedTuple):
    """State that an exposure leaves to the next."""

    pixels: PixelState | None = None
    """Of an array that is running"""
    behind: Floats | None = None
    """Mean detections (H, W) of image lag"""
    counted: Floats | float = 0.0
    """Events (H, W) that an analog counter held, of which a part stays"""


def detection_rate(radiance: ArrayLike, bands_nm: ArrayLike, sensor: Sensor) -> Floats:
    """Detection rate of always-live pixels, (T, H, W), Hz; parameters as for `expose`."""
    rate_hz = optics.detected_rate(radiance, bands_nm, sensor)
    _, rows, columns = rate_hz.shape
    rate_hz *= draw_fixed_pattern(sensor, (rows, columns)).efficiency_factor
    return rate_hz


def expose_frames(
    detections_hz: ArrayLike,
    sensor: Sensor,
    draw: streams.Draw,
    reading: Reading,
    *,
    is_running: bool = False,
    state: ArrayState | None = None,
    together: int = 1,
) -> tuple[Any, ArrayState]:
    """Draw readings of frames of a known detection rate, Hz, (T, H, W) or (T, S, H, W).

    Returns an `Exposure`, `Events`, codes (T, H, W) or packed bits (T, H, ceil(W/8)), and the state
    of the array after the last frame: it starts from `state`. One that is running is not reset
    between frames. `together` frames are drawn from the streams of the first of them.
    """
    pixel_state, behind, counted = state or ArrayState()
    rate_hz = optics.checked_rate(detections_hz, sensor)
    rate_hz, behind = optics.with_lag(rate_hz, sensor, behind)
    frames, *parts, rows, columns = rate_hz.shape
    device, exposure_s = draw_fixed_pattern(sensor, (rows, columns)), sensor.exposure_s
    counter, effects, maps = sensor.counter, sensor.avalanche_effects, device.avalanches
    residue = getattr(counter, "residue_share", 0.0)
    together = 1 if residue else together
    period_s = draw.frame_period_s or exposure_s
    stream = streams.sensor_stream(draw.stream, sensor, device.dark_counts_hz)
    is_running, keeps_times = is_running and effects.has_memory, reading == "events"
    by_event, purpose = is_running or keeps_times, "binary" if reading == "bits" else "exposure"
    is_direct = reading == "counts" and sensor.count_distribution == "Poisson" and not parts
    is_direct &= counter.kind == "digital" and counter.overflow == "saturate" and counter.sums == 1
    for light_hz in rate_hz if by_event else ():
        most = MOST_STORED if keeps_times else counts.MOST_SIMULATED
        counts.check_load(light_hz + device.dark_counts_hz, exposure_s, effects, maps, most)
    shape, is_counted = (frames, rows, columns), reading in ("counts", "codes")
    number_type = "u2" if sensor.largest < 2**16 else "u4"
    readings: counters.Counts = np.empty(shape if is_counted else (0, rows, columns), number_type)
    saturated = np.empty(readings.shape, np.bool_)
    bits = np.empty((frames, rows, -(-columns // 8)), np.uint8)
    events: dict[int, tuple[Floats, NDArray[np.uint32]]] = {}

    def generator(purpose: str, first: int) -> np.random.Generator:
        light = streams.light_key(rate_hz[first])
        return streams.generator(draw.seed, purpose, stream, light, draw.first_frame + first)

    # in a row, which takes a fifth of the time needed in threads
    direct = range(frames if is_direct else 0)
    words = [poisson.poisson_streams(generator("exposure", first)) for first in direct]

    def expose_block(first: int) -> None:
        nonlocal pixel_state, counted
        if reading == "counts" and counter.sums > 1:
            named = draw._replace(first_frame=draw.first_frame + first)
            of_sum = rate_hz[first], sensor, named, is_running, pixel_state
            readings[first], saturated[first], pixel_state = _sum_of_exposures(*of_sum)
            return
        numbers = range(draw.first_frame + first, draw.first_frame + min(first + together, frames))
        # arrivals, Hz: light (H, W) or (S, H, W), and dark carriers; frames drawn together are tall
        light_hz, pixels = rate_hz[first], device
        if together > 1:
            light_hz = np.concatenate(rate_hz[first : first + together], axis=-2)
            pixels = device.repeated(len(numbers))
        dark_hz = pixels.dark_counts_hz
        if device.traps is not None:  # telegraph noise: traps switch between exposures
            run = int(streams.generator(draw.seed, "telegraph", stream).integers(2**63))
            traps, times_s = (sensor.telegraph, device.traps, run), (n * period_s for n in numbers)
            factors = [dark_counts.telegraph_factor(*traps, time_s) for time_s in times_s]
            dark_hz = dark_hz * np.concatenate(factors)
            dark_hz.flags.writeable = False  # as the device's, for which kernels are compiled

        # avalanches
        if by_event:
            rng = generator("events", first)
            simulated = simulate_frame(
                rng, light_hz + dark_hz, exposure_s, effects,
                maps=maps, state=pixel_state, keep_events=keeps_times,
            )  # fmt: skip
            fired, pixel_state = simulated.counts, simulated.state if is_running else None
        elif reading == "bits" and sensor.has_plain_bits:
            # 1 − e^(−r·T): dead time and afterpulses follow the first event
            mean_hz = moments.mean_rate(light_hz, exposure_s, effects) if parts else light_hz
            rates_hz = np.ascontiguousarray(mean_hz), dark_hz
            open_s = exposure_s * open_fraction(sensor.gate, exposure_s)
            bit_words = streams.word_streams(generator("binary", first))
            poisson.fill_bits(bit_words, *rates_hz, open_s, bits[first])
            return
        elif is_direct:  # Poisson, into the counter
            rates_hz, out = (light_hz.ravel(), dark_hz.ravel()), readings[first].ravel()
            poisson.fill_poisson(words[first], *rates_hz, exposure_s, out, counter.capacity)
            return
        elif "crosstalk" in effects.on:
            of_frames = np.split(light_hz + dark_hz, len(numbers), axis=-2)
            rng = generator(purpose, first)
            fired = np.concatenate([_avalanches(rng, hz, sensor, maps) for hz in of_frames])
        else:
            rng = generator(purpose, first)
            fired = _avalanches(rng, light_hz + dark_hz, sensor, pixels.avalanches)

        # readout
        if reading == "events":
            stamps_s = timing.stamp(rng, simulated.times_s, sensor.jitter)
            events[first] = quantities.in_order_of_time(stamps_s, simulated.pixels)
        elif reading == "bits":
            bits[first] = np.packbits(fired > 0, axis=-1)
        elif isinstance(counter, counters.DigitalCounter):
            counters.read_digital(fired, counter, (readings[first], saturated[first]))
        elif pixels.counters is not None:
            if residue:
                most = counter.swing_v / pixels.counters.step_v
                fired = counted = np.minimum(fired + residue * np.asarray(counted), most)
            analog = generator("readout", first), fired, counter, pixels.counters
            if reading == "counts":
                readings[first], saturated[first] = counters.read_analog(*analog, exposure_s)
            else:
                codes = counters.sample_analog(*analog).reshape(-1, rows, columns)
                readings[first : first + together] = codes

    order = list(range(0, frames, together))
    in_turn = is_running or residue > 0
    if sensor.count_distribution == "simulated" and not in_turn:
        # the brightest first, so that light that cannot be drawn is refused at once
        order.sort(key=lambda first: -rate_hz[first].max(initial=0))
    streams.over_frames(expose_block, order, in_turn or math.prod(shape) < 2**15)  # few: one thread
    if is_direct:
        np.greater_equal(readings, counter.capacity, out=saturated)
    if device.stuck is not None:
        stuck = device.stuck >= 0
        readings[:, stuck] = device.stuck[stuck]
        saturated[:, stuck] = device.stuck[stuck] >= sensor.largest
        bits = (bits & ~np.packbits(stuck, axis=-1)) | np.packbits(device.stuck > 0, axis=-1)
    match reading:
        case "counts":
            drawn: Any = quantities.Exposure(readings, saturated)
        case "events":
            in_order = [events[frame] for frame in range(frames)]
            drawn = quantities.joined(in_order, shape, draw.first_frame)
        case "bits" | "codes":
            drawn = bits if reading == "bits" else readings
    return drawn, ArrayState(pixel_state, behind, counted)


def lights_of_sum(rate_hz: Floats, sums: int) -> list[tuple[Floats, int]]:
    """Light, Hz, of the exposures of a sum in a frame of light, and how many have it."""
    if rate_hz.ndim == 2 or sums == 1:
        return [(rate_hz, sums)]
    lights = [light.mean(axis=0) for light in np.array_split(rate_hz, min(sums, len(rate_hz)))]
    numbers = np.bincount(np.arange(sums) * len(lights) // sums)
    return list(zip(lights, numbers.tolist(), strict=True))


def _sum_of_exposures(
    rate_hz: Floats, sensor: Sensor, draw: streams.Draw, is_running: bool, pixels: PixelState | None
) -> tuple[NDArray[np.uint32], NDArray[np.bool_], PixelState | None]:
    """Draw a sum and its flags (H, W), and the state of a running array after it."""
    counter, shape = sensor.counter, rate_hz.shape[-2:]
    device, sums = draw_fixed_pattern(sensor, (shape[0], shape[1])), counter.sums
    alone = {"counter": {"sums": 1}, "lag_share": 0.0, "measured": {"stuck": None}}
    part, state = changed(sensor, exposure_s=sensor.counted_s, **alone), ArrayState(pixels)
    period_s = (draw.frame_period_s or sensor.exposure_s) / sums
    stream = streams.sensor_stream(draw.stream, sensor, device.dark_counts_hz)
    is_binomial = counter.capacity == 1 and sensor.has_plain_bits and device.traps is None
    open_s = part.exposure_s * open_fraction(sensor.gate, part.exposure_s)
    total, flags = np.zeros(shape, np.uint32), np.zeros(shape, np.bool_)
    first, wraps = draw.first_frame * sums, getattr(counter, "overflow", "") == "wrap"
    for light_hz, exposures in lights_of_sum(rate_hz, sums):
        if is_binomial and not is_running:
            name = "sums", stream, streams.light_key(light_hz), first
            chance = -np.expm1(-(light_hz + device.dark_counts_hz) * open_s)
            bits = streams.generator(draw.seed, *name).binomial(exposures, chance)
            total, first = total + bits.astype(np.uint32), first + exposures
            continue
        while exposures:
            together = np.broadcast_to(light_hz, (min(16, exposures), *shape))  # exposures at once
            named = streams.Draw(draw.seed, draw.stream, first, period_s)
            drawn, state = expose_frames(
                together, part, named, "counts", is_running=is_running, state=state
            )
            total += drawn.counts.sum(axis=0, dtype=np.uint32)
            flags |= drawn.saturated.any(axis=0)
            first, exposures = first + len(together), exposures - len(together)
    return total, flags if wraps else total >= sensor.largest, state.pixels


def _avalanches(
    rng: np.random.Generator, arrivals_hz: Floats, sensor: Sensor, maps: AvalancheMaps | None
) -> Ints:
    """Draw the avalanches (H, W) of an exposure from arrivals, Hz, (H, W) or in parts (S, H, W)."""
    exposure_s, effects = sensor.exposure_s, sensor.avalanche_effects
    if sensor.count_distribution == "simulated" or (arrivals_hz.ndim == 3 and effects.has_memory):
        return counts.draw_frame(rng, arrivals_hz, exposure_s, effects, maps)
    if sensor.count_distribution == "dead time":
        scale = 1.0 if maps is None else maps.dead_time
        return dead_time.draw_counts(rng, arrivals_hz, exposure_s, sensor.dead_time, scale)
    if arrivals_hz.ndim == 3:
        arrivals_hz = moments.mean_rate(arrivals_hz, exposure_s, effects)
    open_hz = arrivals_hz * open_fraction(sensor.gate, exposure_s)
    primaries = poisson.draw_poisson(rng, open_hz.ravel(), factor=exposure_s)
    strength = None if maps is None else maps.crosstalk
    return crosstalk.spread(rng, primaries.reshape(open_hz.shape), sensor.crosstalk, strength)
