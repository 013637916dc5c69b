"""One exposure, step by step in physical order.

    optics        radiance of a scene → photons per second on every pixel (`optics`)
    detection     → detection rate of an always-live pixel (`detection_rate`)
    dark counts   + thermal carriers, at a rate that may change with time (`_Frames`)
    avalanches    → events: gate, dead time, afterpulses, crosstalk (`avalanches`)
    counter       → counts, up to its capacity (`spad.counters`)
    readout       counts, codes of an ADC, bits, or the time of every event

The rate is that of the frame's radiance for the whole exposure, or (T, S, H, W) in S equal parts of
it. Motion blur, if any, is already in the radiance. An array of CTIA pixels (`ctia`) integrates a
photocurrent instead.

Every frame has its own random streams, named by seed, stream, sensor, light and frame number. A
frame's draws thus depend neither on other frames drawn with it, nor on the number of threads.
Exposures that differ in any of these are independent; equal ones give equal readings. Counts,
events and bits are drawn from different streams: they agree in distribution, not count by count.
For an array with memory that is not reset between frames, they are drawn avalanche by avalanche
from the same streams, and are the same events.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from megalopta.core.arrays import Floats, Ints
from megalopta.sensor.ctia.model import (
    CtiaSensor,
    expose_photocurrent,
    photocurrent,
    reading_electrons,
)
from megalopta.sensor.effects.base import AvalancheMaps, Frame
from megalopta.sensor.effects.dead_time import check_arrivals
from megalopta.sensor.effects.gating import open_fraction
from megalopta.sensor.effects.timing import stamp
from megalopta.sensor.expectations import expectation as expectation_of
from megalopta.sensor.image_sensors import ImageSensor
from megalopta.sensor.quantities import Events, Exposure, in_order_of_time, joined
from megalopta.sensor.sampling.poisson import draw_poisson, fill_bits, fill_poisson, poisson_streams
from megalopta.sensor.sampling.streams import generator, light_key, sensor_stream, word_streams
from megalopta.sensor.spad.counters import (
    AnalogCounter,
    AnalogPixels,
    empty_counts,
    read_analog,
    read_digital,
    sample_analog,
)
from megalopta.sensor.spad.counts import MOST_SIMULATED, check_load, draw_frame
from megalopta.sensor.spad.device import FixedPattern, checked_rate, detection_rate, over_frames
from megalopta.sensor.spad.model import Sensor
from megalopta.sensor.spad.moments import mean_rate
from megalopta.sensor.spad.simulation import FreeRunning, SimulatedFrame

_FEW_PIXELS = 2**15
"""Below this number of pixels in all frames, one thread draws them."""
MOST_STORED = 5e7
"""Most events of a frame whose times are kept: about 3 GB while drawn and sorted."""


def expose(
    radiance: ArrayLike,
    bands_nm: ArrayLike,
    sensor: ImageSensor | str,
    *,
    seed: int,
    stream: str | int,
    first_frame: int = 0,
    frame_period_s: float | None = None,
    expectation: bool = False,
) -> Exposure:
    """Simulate a sensor's readings of a scene: counts, or electrons of a CTIA array.

    Raises ValueError if the radiance is negative, not finite, too bright or of the wrong shape, a
    band reaches outside the efficiency curve, or the sensor's device is impossible; TypeError if
    the sensor is not one, or seed or stream has the wrong type.

    Parameters
    ----------
    radiance : (T, H, W, B) array
        Band means, W·m⁻²·sr⁻¹·nm⁻¹.
    bands_nm : (B, 2) array
        Lower and upper edge of each band, nm.
    sensor
        A sensor, or a preset's name.
    stream : str or int
        Name of the draws; a frame's readings are a function of it, seed, sensor, light and frame
        number.
    first_frame : int
        Sequence number of the first of these frames.
    frame_period_s : float, optional
        Time between frames, for effects that change with time; default: the exposure.
    expectation : bool
        True to compute mean and variance too, which about doubles the cost.
    """
    from megalopta.sensor.image_sensors import sensor_named  # which imports this module

    sensor = sensor_named(sensor)
    named: dict[str, Any] = {
        "seed": seed,
        "stream": stream,
        "first_frame": first_frame,
        "frame_period_s": frame_period_s,
    }
    if isinstance(sensor, CtiaSensor):
        light = photocurrent(radiance, bands_nm, sensor)
        reading = expose_photocurrent(light, sensor, **named)
        electrons = reading_electrons(reading.volts, sensor).astype(np.float32)
        exposure = Exposure(electrons, reading.saturated)
    else:
        exposure = expose_rate(detection_rate(radiance, bands_nm, sensor), sensor, **named)
    if not expectation:
        return exposure
    stated = expectation_of(radiance, bands_nm, sensor, first_frame, frame_period_s)
    return replace(exposure, expectation=stated)


def expose_rate(
    detections_hz: ArrayLike,
    sensor: Sensor,
    *,
    seed: int,
    stream: str | int,
    first_frame: int = 0,
    frame_period_s: float | None = None,
    free_running: bool | FreeRunning = False,
) -> Exposure:
    """Draw the counts of frames of known detection rate; other parameters as for `expose`.

    Parameters
    ----------
    detections_hz : (T, H, W) or (T, S, H, W) array
        Hz, constant over an exposure or in S equal parts of it (`sub_frames`); `detection_rate`
        gives that of a scene.
    free_running : bool or FreeRunning
        Exposures follow each other without a gap and pixels keep their state: from the first frame
        of this call, or from the end of the array's previous call. Frames then depend on those
        before.
    """
    frames = _Frames.of(detections_hz, sensor, seed, stream, first_frame, frame_period_s)
    array, counter = frames.running(free_running), sensor.counter
    exposure = Exposure(
        empty_counts(frames.shape, counter.capacity), np.empty(frames.shape, np.bool_)
    )
    if frames.are_poisson and counter.kind == "digital" and counter.overflow == "saturate":
        # allocated in a row, which takes a fifth of the time needed in threads
        sources = [
            poisson_streams(frames.rng("exposure", index)) for index in range(frames.shape[0])
        ]

        def count(index: int) -> None:
            light_hz, dark_hz = (rates_hz.ravel() for rates_hz in frames.rates(index))
            counts, exposure_s = exposure.counts[index].reshape(-1), sensor.exposure_s
            fill_poisson(sources[index], light_hz, dark_hz, exposure_s, counts, counter.capacity)

        frames.each(count)
        np.greater_equal(exposure.counts, counter.capacity, out=exposure.saturated)
        return frames.with_stuck(exposure)

    def expose_frame(index: int) -> None:
        out = exposure.counts[index], exposure.saturated[index]
        if array:
            events = frames.simulated(array, index, keep_events=False).counts
        else:
            events = frames.events(index)
        if isinstance(counter, AnalogCounter):
            assert frames.device.counters is not None
            noise, pixels = frames.rng("readout", index), frames.device.counters
            out[0][:], out[1][:] = read_analog(noise, events, counter, pixels, sensor.exposure_s)
        else:
            read_digital(events, counter, out)

    # the brightest first, so that light that cannot be drawn is refused at once
    order = np.argsort([-light.max(initial=0) for light in frames.detections_hz], kind="stable")
    if array:
        frames.each(expose_frame, in_turn=True)
    else:
        frames.each(lambda place: expose_frame(int(order[place])))
    return frames.with_stuck(exposure)


def expose_adc(
    detections_hz: ArrayLike,
    sensor: Sensor,
    *,
    seed: int,
    stream: str | int,
    first_frame: int = 0,
    together: int = 1,
) -> NDArray[np.uint16]:
    """Draw the ADC codes (T, H, W) of analog counters; as `expose_rate`.

    The same seed, stream and frame give the same events and noise as there. Several frames may be
    drawn `together` from the streams of the first: for small arrays, naming a stream costs more
    than drawing a frame.

    Raises ValueError as `expose_rate`, or if the sensor has no analog counter with an ADC of 16
    bits or less.
    """
    frames = _Frames.of(detections_hz, sensor, seed, stream, first_frame, None)
    counter, pixels = sensor.counter, frames.device.counters
    if not isinstance(counter, AnalogCounter) or pixels is None:
        raise ValueError("counter.kind: 'digital'; only an analog counter is read by an ADC")
    codes = np.empty(frames.shape, np.uint16)

    def expose_together(place: int) -> None:
        first = place * together
        events = frames.events_together(first, together)
        tall = AnalogPixels(*(np.tile(each, (len(events), 1)) for each in pixels))
        noise = frames.rng("readout", first)
        read = sample_analog(noise, events.reshape(tall.step_v.shape), counter, tall)
        codes[first : first + together] = read.reshape(events.shape)

    frames.each(expose_together, -(-frames.shape[0] // together))
    return codes


def expose_binary(
    detections_hz: ArrayLike,
    sensor: Sensor,
    *,
    seed: int,
    stream: str | int,
    first_frame: int = 0,
    frame_period_s: float | None = None,
    free_running: bool | FreeRunning = False,
) -> NDArray[np.uint8]:
    """Draw binary frames, packed (T, H, ceil(W/8)) uint8; as `expose_rate`.

    The bit is 1 with probability p = 1 − exp(−r·T) from a live start; mean p, variance p·(1−p).
    Dead time and afterpulses act only after the first event. With a gate, T is the open time; if
    light changes within the exposure, r is its mean over that time. Bits are packed as visionsim
    does: `np.packbits` along the width, the last byte of a row padded with zeros.

    Raises ValueError as `expose_rate`, or as `check_binary`.
    """
    check_binary(sensor)
    frames = _Frames.of(detections_hz, sensor, seed, stream, first_frame, frame_period_s)
    count, rows, columns = frames.shape
    packed = np.empty((count, rows, -(-columns // 8)), np.uint8)
    array = frames.running(free_running)
    open_s = sensor.exposure_s * open_fraction(sensor.gate, sensor.exposure_s)

    def expose_frame(index: int) -> None:
        if array:
            counts = frames.simulated(array, index, keep_events=False).counts
            packed[index] = np.packbits(counts > 0, axis=-1)
            return
        light_hz, dark_hz = frames.rates(index)
        if light_hz.ndim == 3:
            light_hz = mean_rate(light_hz, sensor.exposure_s, sensor.avalanche_effects)
        streams = word_streams(frames.rng("binary", index))
        fill_bits(streams, np.ascontiguousarray(light_hz), dark_hz, open_s, packed[index])

    frames.each(expose_frame, in_turn=array is not None)
    if frames.device.stuck is not None:
        at_one, at_any = (np.packbits(frames.device.stuck > least, axis=-1) for least in (0, -1))
        packed = (packed & ~at_any) | at_one
    return packed


def expose_events(
    detections_hz: ArrayLike,
    sensor: Sensor,
    *,
    seed: int,
    stream: str | int,
    first_frame: int = 0,
    frame_period_s: float | None = None,
    free_running: bool | FreeRunning = False,
) -> Events:
    """Draw the time and pixel of every avalanche, instead of counts.

    An event-based array reports every avalanche and has no counter. Other parameters, and errors,
    are those of `expose_rate`.

    `detections_hz` (T, H, W) or (T, S, H, W); `sensor`: its jitter scatters the time stamps.
    """
    frames = _Frames.of(detections_hz, sensor, seed, stream, first_frame, frame_period_s)
    array = frames.running(free_running, MOST_STORED)
    streams: dict[int, tuple[Floats, NDArray[np.uint32]]] = {}

    def expose_frame(index: int) -> None:
        rng = frames.rng("events", index)
        simulated = frames.simulated(array or FreeRunning(), index, rng)
        stamps = stamp(rng, simulated.times_s, sensor.jitter)
        streams[index] = in_order_of_time(stamps, simulated.pixels)

    frames.each(expose_frame, in_turn=array is not None)
    return joined([streams[index] for index in range(len(streams))], frames.shape, first_frame)


def check_binary(sensor: Sensor) -> None:
    """Check that a sensor has binary frames: the first event depends only on the rate.

    Raises ValueError with crosstalk, or with dead time or afterpulses and a stationary start.
    """
    if sensor.crosstalk.is_on:
        raise ValueError(
            f"crosstalk.mean_fired_neighbors: {sensor.crosstalk.mean_fired_neighbors:g}; binary "
            "frames have none: switch it off, or use a counter of capacity 1 with expose_rate"
        )
    if sensor.dead_time.start == "stationary" and sensor.avalanche_effects.has_memory:
        raise ValueError(
            "dead_time.start: 'stationary'; binary frames start live: choose 'live', or use a "
            "counter of capacity 1 with expose_rate"
        )


@dataclass(frozen=True, eq=False)
class _Frames:
    """Frames of one call: rates, device, and names of the random streams."""

    detections_hz: Floats
    device: FixedPattern
    sensor: Sensor
    seed: int
    stream: str
    first: int
    period_s: float

    @classmethod
    def of(
        cls,
        detections_hz: ArrayLike,
        sensor: Sensor,
        seed: int,
        stream: str | int,
        first_frame: int,
        period_s: float | None,
    ) -> "_Frames":
        rate, device = checked_rate(detections_hz, sensor)
        period_s = period_s or sensor.exposure_s
        named = sensor_stream(stream, sensor, device.dark_counts_hz)
        return cls(rate, device, sensor, seed, named, first_frame, period_s)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Frames, rows, columns."""
        rows, columns = self.detections_hz.shape[-2:]
        return len(self.detections_hz), rows, columns

    @property
    def are_poisson(self) -> bool:
        """True if no effect acts on avalanches and light is constant within exposures."""
        return not self.sensor.avalanche_effects.on and self.detections_hz.ndim == 3

    def running(
        self, asked: bool | FreeRunning, most: float = MOST_SIMULATED
    ) -> FreeRunning | None:
        """Array that continues between frames, new for True; None where frames are independent.

        Raises UserError, before any is drawn, if a frame that is simulated has too many events.
        """
        is_running = bool(asked) and self.sensor.avalanche_effects.has_memory
        if is_running or most == MOST_STORED:
            for detections_hz in self.detections_hz:
                self._check_load(detections_hz + self.device.dark_counts_hz, most)
        if not is_running:
            return None
        return asked if isinstance(asked, FreeRunning) else FreeRunning()

    def _check_load(self, arrivals_hz: Floats, most: float) -> None:
        exposure_s, effects = self.sensor.exposure_s, self.sensor.avalanche_effects
        check_load(arrivals_hz, exposure_s, effects, self.device.avalanches, most)

    def rng(self, purpose: str, index: int) -> np.random.Generator:
        """Return the random generator of one frame and purpose."""
        light = light_key(self.detections_hz[index])
        return generator(self.seed, purpose, self.stream, light, self.first + index)

    def rates(self, index: int) -> tuple[Floats, Floats]:
        """Detections and dark counts of a frame, Hz, after the effects that change with time."""
        detections_hz, dark_hz = self.detections_hz[index], self.device.dark_counts_hz
        if not self.device.in_time:
            return detections_hz, dark_hz
        number = self.first + index
        rates = self.device.rates(detections_hz.copy())
        rates.dark_counts_hz = dark_hz.copy()
        for name, effect in self.device.in_time:
            run = generator(self.seed, name, self.stream).integers(2**63)
            frame = Frame(number, number * self.period_s, int(run))
            effect.act_on_frame(rates, self.rng(name, index), frame)
        rates.dark_counts_hz.flags.writeable = False  # as in the device: compiled once
        return rates.detections_hz, rates.dark_counts_hz

    def events(self, index: int) -> Ints:
        """Number of avalanches of every pixel in a frame, (H, W)."""
        detections_hz, dark_hz = self.rates(index)
        rng, exposure_s = self.rng("exposure", index), self.sensor.exposure_s
        if self.are_poisson:  # the same, faster, for rates checked before
            drawn = draw_poisson(rng, detections_hz.ravel(), dark_hz.ravel(), exposure_s)
            return drawn.reshape(detections_hz.shape)
        effects, maps = self.sensor.avalanche_effects, self.device.avalanches
        return draw_frame(rng, detections_hz + dark_hz, exposure_s, effects, maps)

    def events_together(self, first: int, number: int) -> Ints:
        """Avalanches of several frames (n, H, W) from one stream."""
        indices = range(first, min(first + number, len(self.detections_hz)))
        arrivals_hz = np.stack([np.add(*self.rates(index)) for index in indices])
        rng, exposure_s = self.rng("exposure", first), self.sensor.exposure_s
        effects, maps = self.sensor.avalanche_effects, self.device.avalanches
        if effects.crosstalk.is_on:
            each = [draw_frame(rng, one, exposure_s, effects, maps) for one in arrivals_hz]
            return np.array(each)
        # Pixels without crosstalk can be treated as those of one tall frame.
        frames, *parts, rows, columns = arrivals_hz.shape
        tall_hz = np.moveaxis(arrivals_hz, 0, -3).reshape(*parts, frames * rows, columns)
        if maps is not None:
            maps = AvalancheMaps(*(np.tile(each, (frames, 1)) for each in maps))
        counts = draw_frame(rng, tall_hz, exposure_s, effects, maps)
        return counts.reshape(frames, rows, columns)

    def with_stuck(self, exposure: Exposure) -> Exposure:
        """Overwrite the readings of stuck pixels."""
        if self.device.stuck is not None:
            stuck = self.device.stuck >= 0
            exposure.counts[:, stuck] = self.device.stuck[stuck]
            full = self.device.stuck[stuck] >= self.sensor.counter.capacity
            exposure.saturated[:, stuck] = full
        return exposure

    def simulated(
        self,
        array: FreeRunning,
        index: int,
        rng: np.random.Generator | None = None,
        keep_events: bool = True,
    ) -> SimulatedFrame:
        """Simulate a frame avalanche by avalanche, from the array's state."""
        arrivals_hz = np.add(*self.rates(index))
        effects, maps = self.sensor.avalanche_effects, self.device.avalanches
        check_arrivals(arrivals_hz, self.sensor.exposure_s)
        self._check_load(arrivals_hz, MOST_STORED if keep_events else MOST_SIMULATED)
        return array.expose(
            rng or self.rng("events", index),
            arrivals_hz,
            self.sensor.exposure_s,
            effects,
            maps,
            keep_events=keep_events,
        )

    def each(
        self, task: Callable[[int], None], times: int | None = None, in_turn: bool = False
    ) -> None:
        """Run a task for every frame, or `times` times, in threads unless `in_turn`."""
        times = self.shape[0] if times is None else times
        over_frames(task, times, in_turn or math.prod(self.shape) < _FEW_PIXELS)
