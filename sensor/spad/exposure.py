"""One exposure of the sensor: from the radiance of a scene to counts.

What happens on the way, and in which order, is the list in `order`. The rate is that of the frame's
radiance for the whole exposure: motion blur, if wanted, is in the radiance already.

Every frame has its own random streams, named by seed, sequence and frame number, so the counts of a
frame do not depend on which others are drawn with it, nor on the number of threads. Draws that must
be independent, such as those of two light levels, need different names for `sequence`.

`expose_adc` can draw several frames from one stream, which is then named by the first of them: of
small arrays, to name a stream costs more than to draw a frame.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from megalopta.core.arrays import Floats
from megalopta.sensor.avalanches.counts import draw_counts
from megalopta.sensor.avalanches.running import FreeRunning, running_array
from megalopta.sensor.effects.fields import AvalancheEffects
from megalopta.sensor.effects.mismatch import AvalancheMaps
from megalopta.sensor.quantities import Exposure
from megalopta.sensor.sampling.poisson import draw_poisson, fill_poisson, poisson_streams
from megalopta.sensor.sampling.streams import generator
from megalopta.sensor.spad.analog import AnalogCounter, AnalogPixels
from megalopta.sensor.spad.conversion import read_analog, sample_analog
from megalopta.sensor.spad.digital import empty_counts, read_digital
from megalopta.sensor.spad.fixed_pattern import FixedPattern
from megalopta.sensor.spad.frames import over_frames
from megalopta.sensor.spad.model import Sensor
from megalopta.sensor.spad.moments import spad_expectation
from megalopta.sensor.spad.rates import checked_rate, detection_rate
from megalopta.sensor.spad.running import running_counts


def expose(
    radiance: ArrayLike,
    bands_nm: ArrayLike,
    sensor: Sensor,
    *,
    seed: int,
    sequence: str | int,
    first_frame: int = 0,
    threads: int | None = None,
    expectation: bool = False,
) -> Exposure:
    """Draw the counts of frames of a scene.

    Parameters
    ----------
    radiance : (T, H, W, B) array
        Band means, W·m⁻²·sr⁻¹·nm⁻¹.
    bands_nm : (B, 2) array
        Lower and upper edge of each band, nm.
    sensor : Sensor
    seed : int
    sequence : str or int
        Name of what is drawn; the counts of a frame are a function of seed, sequence and frame.
    first_frame : int
        Number of the first of these frames in the sequence.
    threads : int, optional
        How many frames to draw at the same time, 1 or more; by default as many as there are cores.
    expectation : bool
        Whether to state mean and variance too, which costs about as much again.

    Raises
    ------
    ValueError
        When the radiance is negative, not finite, too bright or of the wrong shape, a band reaches
        outside the efficiency curve, or the sensor's device cannot be made.
    TypeError
        When the sensor is none, or seed or sequence names nothing.
    """
    rate = detection_rate(radiance, bands_nm, sensor)
    exposure = expose_rate(
        rate, sensor, seed=seed, sequence=sequence, first_frame=first_frame, threads=threads
    )
    if not expectation:
        return exposure
    return replace(exposure, expectation=spad_expectation(radiance, bands_nm, sensor, threads))


def expose_rate(
    detections_hz: ArrayLike,
    sensor: Sensor,
    *,
    seed: int,
    sequence: str | int,
    first_frame: int = 0,
    free_running: bool | FreeRunning = False,
    threads: int | None = None,
) -> Exposure:
    """Draw the counts of frames whose detection rate is known; other parameters as for `expose`.

    Parameters
    ----------
    detections_hz : (T, H, W) or (T, S, H, W) array
        Hz, constant over an exposure or in S equal parts of it.
    sensor : Sensor
    free_running : bool or FreeRunning
        As for `expose_events`, whose events these counts then number.
    """
    rate, device = checked_rate(detections_hz, sensor)
    effects, counter = sensor.avalanche_effects, sensor.counter
    array = running_array(free_running, effects)
    shape = rate.shape[0], *rate.shape[-2:]
    exposure = Exposure(empty_counts(shape, counter.capacity), np.empty(shape, np.bool_))
    is_plain = counter.kind == "digital" and counter.overflow == "saturate" and rate.ndim == 3
    if is_plain and not effects.on and not array:
        _count_poisson(rate, sensor, device, (seed, sequence, first_frame), exposure, threads)
        return exposure

    def expose_frame(frame: int) -> None:
        key = sequence, first_frame + frame
        out = exposure.counts[frame], exposure.saturated[frame]
        if array:
            events = running_counts(array, rate[frame], sensor, device, seed, key)
        else:
            events = _events(rate[frame], sensor, effects, device, seed, key)
        if isinstance(counter, AnalogCounter):
            assert device.counters is not None
            noise = generator(seed, "readout", *key)
            out[0][:], out[1][:] = read_analog(
                noise, events, counter, device.counters, sensor.exposure_s
            )
        else:
            read_digital(events, counter, out)

    over_frames(expose_frame, len(rate), 1 if array else threads)
    return exposure


def expose_adc(
    detections_hz: ArrayLike,
    sensor: Sensor,
    *,
    seed: int,
    sequence: str | int,
    first_frame: int = 0,
    threads: int | None = None,
    together: int = 1,
) -> NDArray[np.uint16]:
    """Draw what the ADC behind analog counters reads, codes (T, H, W); as `expose_rate`.

    The same seed, sequence and frame make the same events and noise as there, with `together`
    frames from one stream those of its first.

    Raises
    ------
    ValueError
        As `expose_rate`, or when the sensor has no analog counter with an ADC of 16 bits or less.
    """
    rate, device = checked_rate(detections_hz, sensor)
    counter, pixels = sensor.counter, device.counters
    if not isinstance(counter, AnalogCounter) or pixels is None:
        raise ValueError("counter.kind: 'digital'; only an analog counter is read by an ADC")
    codes = np.empty((rate.shape[0], *rate.shape[-2:]), np.uint16)

    def expose_together(place: int) -> None:
        frames = slice(place * together, (place + 1) * together)
        key = sequence, first_frame + frames.start
        events = _events_together(rate[frames], sensor, device, seed, key)
        tall = AnalogPixels(*(np.tile(each, (len(events), 1)) for each in pixels))
        noise = generator(seed, "readout", *key)
        read = sample_analog(noise, events.reshape(tall.step_v.shape), counter, tall)
        codes[frames] = read.reshape(events.shape)

    over_frames(expose_together, -(-len(rate) // together), threads)
    return codes


def _count_poisson(
    rate: Floats,
    sensor: Sensor,
    device: FixedPattern,
    key: tuple[int, str | int, int],
    exposure: Exposure,
    threads: int | None,
) -> None:
    """Draw as `_events` and read at once: nothing acts on events but a counter that saturates."""
    (seed, sequence, first), capacity = key, sensor.counter.capacity
    # made in a row, which takes a fifth of the time that they take one by one
    rngs = [generator(seed, "exposure", sequence, first + frame) for frame in range(len(rate))]
    sources = [poisson_streams(rng) for rng in rngs]
    dark_hz = device.dark_counts_hz.ravel()

    def expose_frame(frame: int) -> None:
        counts = exposure.counts[frame].reshape(-1)
        light_hz = rate[frame].ravel()
        fill_poisson(sources[frame], light_hz, dark_hz, sensor.exposure_s, counts, capacity)

    over_frames(expose_frame, len(rate), threads)
    np.greater_equal(exposure.counts, capacity, out=exposure.saturated)


def _events(
    detections_hz: NDArray[np.float64],
    sensor: Sensor,
    effects: AvalancheEffects,
    device: FixedPattern,
    seed: int,
    key: tuple[str | int, int],
) -> NDArray[np.int64]:
    rng = generator(seed, "exposure", *key)
    if not effects.on and detections_hz.ndim == 2:  # the same, faster, of rates checked before
        flat = detections_hz.ravel(), device.dark_counts_hz.ravel()
        return draw_poisson(rng, *flat, sensor.exposure_s).reshape(detections_hz.shape)
    arrivals_hz = detections_hz + device.dark_counts_hz
    return draw_counts(rng, arrivals_hz, sensor.exposure_s, effects, device.avalanches)


def _events_together(
    detections_hz: NDArray[np.float64],
    sensor: Sensor,
    device: FixedPattern,
    seed: int,
    key: tuple[str | int, int],
) -> NDArray[np.int64]:
    """Events of frames (n, …, rows, columns) from one stream."""
    arrivals_hz = detections_hz + device.dark_counts_hz
    rng = generator(seed, "exposure", *key)
    effects, maps = sensor.avalanche_effects, device.avalanches
    if effects.crosstalk.is_on:
        each = [draw_counts(rng, one, sensor.exposure_s, effects, maps) for one in arrivals_hz]
        return np.array(each)
    # Pixels that do not know of each other may as well be those of one tall frame.
    frames, *parts, rows, columns = arrivals_hz.shape
    tall_hz = np.moveaxis(arrivals_hz, 0, -3).reshape(*parts, frames * rows, columns)
    if maps is not None:
        maps = AvalancheMaps(*(np.tile(each, (frames, 1)) for each in maps))
    counts = draw_counts(rng, tall_hz, sensor.exposure_s, effects, maps)
    return counts.reshape(frames, rows, columns)
