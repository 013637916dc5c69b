"""One exposure of the sensor: from the radiance of a scene to counts.

What happens on the way, and in which order, is the list in `order`. The rate is that of the frame's
radiance for the whole exposure: motion blur, if wanted, is in the radiance already.

Every frame has its own random streams, named by seed, sequence and frame number, so the counts of a
frame do not depend on which others are drawn with it, nor on the number of threads. Draws that must
be independent, such as those of two light levels, need different names for `sequence`.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from megalopta.sensor.avalanches import count_moments, draw_counts
from megalopta.sensor.counters import AnalogCounter, Counts, empty_counts, read_analog, read_digital
from megalopta.sensor.effects import MOST_ARRIVALS
from megalopta.sensor.optics import check_brightness, detected_rate
from megalopta.sensor.sampling import generator
from megalopta.sensor.spad.fixed_pattern import FixedPattern, draw_fixed_pattern
from megalopta.sensor.spad.model import Sensor

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Exposure:
    """Frames as the sensor read them.

    Attributes
    ----------
    counts : (T, H, W) uint16 or uint32
        Detected events per exposure; not to be trusted where saturated. From a sensor that
        integrates (`image_sensor`): electrons, float32.
    expected : (T, H, W) float64
        Mean number of events that reach the counter: the noise-free twin.
    saturated : (T, H, W) bool
        Where the counter was full, so that the count is a lower bound, or has wrapped.
    """

    counts: Counts | NDArray[np.float32]
    expected: Floats
    saturated: NDArray[np.bool_]


def expose(
    radiance: ArrayLike,
    bands_nm: ArrayLike,
    sensor: Sensor,
    *,
    seed: int,
    sequence: str | int,
    first_frame: int = 0,
    threads: int | None = None,
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

    Raises
    ------
    ValueError
        When the radiance is negative, not finite, too bright or of the wrong shape, a band reaches
        outside the efficiency curve, or the sensor's device cannot be made.
    TypeError
        When the sensor is none, or seed or sequence names nothing.
    """
    rate = detection_rate(radiance, bands_nm, sensor)
    return expose_rate(
        rate, sensor, seed=seed, sequence=sequence, first_frame=first_frame, threads=threads
    )


def expose_rate(
    detections_hz: ArrayLike,
    sensor: Sensor,
    *,
    seed: int,
    sequence: str | int,
    first_frame: int = 0,
    threads: int | None = None,
) -> Exposure:
    """Draw the counts of frames whose detection rate is known, (T, H, W) in Hz; as `expose`."""
    rate, device = checked_rate(detections_hz, sensor)
    exposure = Exposure(
        empty_counts(rate.shape, sensor.counter.capacity),
        np.empty(rate.shape),
        np.empty(rate.shape, np.bool_),
    )

    def expose_frame(frame: int) -> None:
        key = sequence, first_frame + frame
        arrivals_hz = rate[frame] + device.dark_counts_hz
        rng = generator(seed, "exposure", *key)
        effects = sensor.avalanche_effects
        events = draw_counts(rng, arrivals_hz, sensor.exposure_s, effects, device.avalanches)
        readout = _read_counters(events, sensor, device, lambda: generator(seed, "readout", *key))
        exposure.counts[frame], exposure.saturated[frame] = readout
        exposure.expected[frame], _ = count_moments(
            arrivals_hz, sensor.exposure_s, effects, device.avalanches
        )

    over_frames(expose_frame, len(rate), threads)
    return exposure


def over_frames(task: Callable[[int], None], frames: int, threads: int | None = None) -> None:
    """Run a task for every frame number, in threads; it must write to places of its own."""
    if threads is not None and threads < 1:
        raise ValueError(f"threads: {threads}; give 1 or more, or none for all cores")
    workers = min(threads or os.cpu_count() or 1, frames)
    if workers <= 1:
        for frame in range(frames):
            task(frame)
        return
    with ThreadPoolExecutor(workers) as pool:
        for _ in pool.map(task, range(frames)):
            pass


def checked_rate(detections_hz: ArrayLike, sensor: Sensor) -> tuple[Floats, FixedPattern]:
    """Rate as (frames, rows, columns) and the device that sees it, or refuse the rate.

    Raises
    ------
    ValueError
        When the rate has another shape, is negative, not finite or too high to be drawn.
    """
    _check_sensor(sensor)
    rate = np.asarray(detections_hz, np.float64)
    if rate.ndim != 3:
        raise ValueError(f"detections_hz: shape {rate.shape}; give (frames, rows, columns)")
    most = MOST_ARRIVALS / sensor.exposure_s
    if rate.size and not (rate.min() >= 0 and rate.max() <= most):
        raise ValueError(
            f"detections_hz: from {rate.min():g} to {rate.max():g}; must be finite, not negative "
            f"and at most {most:g} Hz ({MOST_ARRIVALS:g} an exposure)"
        )
    _, rows, columns = rate.shape
    return rate, draw_fixed_pattern(sensor, (rows, columns))


def _read_counters(
    events: NDArray[np.int64],
    sensor: Sensor,
    device: FixedPattern,
    noise: Callable[[], np.random.Generator],
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    if isinstance(sensor.counter, AnalogCounter):
        assert device.counters is not None
        return read_analog(noise(), events, sensor.counter, device.counters, sensor.exposure_s)
    return read_digital(events, sensor.counter)


def detection_rate(radiance: ArrayLike, bands_nm: ArrayLike, sensor: Sensor) -> Floats:
    """Photons per second that each pixel would detect if always live, (T, H, W); as `expose`."""
    _check_sensor(sensor)
    rate = detected_rate(radiance, bands_nm, sensor)
    _, rows, columns = rate.shape
    rate *= draw_fixed_pattern(sensor, (rows, columns)).efficiency_factor
    return check_brightness(rate, sensor.exposure_s)


def expected_counts(radiance: ArrayLike, bands_nm: ArrayLike, sensor: Sensor) -> Floats:
    """Mean number of events per exposure, (T, H, W), dark counts included; as `expose`."""
    return _moments(detection_rate(radiance, bands_nm, sensor), sensor)[0]


def signal_to_noise(radiance: ArrayLike, bands_nm: ArrayLike, sensor: Sensor) -> Floats:
    """Ratio of signal counts to the standard deviation of all counts, (T, H, W); as `expose`.

    The signal is what the light adds to the expected count: less than the detections where dead
    time matters, negative where a paralyzable pixel reads less than in the dark, 0 where nothing is
    counted at all. What the counter does is not included.
    """
    light_hz = detection_rate(radiance, bands_nm, sensor)
    mean, variance = _moments(light_hz, sensor)
    signal, noise = mean - _moments(0 * light_hz[:1], sensor)[0], np.sqrt(variance)
    return np.divide(signal, noise, out=np.zeros_like(signal), where=noise > 0)


def _moments(detections_hz: Floats, sensor: Sensor) -> tuple[Floats, Floats]:
    rate, device = checked_rate(detections_hz, sensor)
    mean, variance = np.empty(rate.shape), np.empty(rate.shape)
    for frame, frame_hz in enumerate(rate):
        mean[frame], variance[frame] = count_moments(
            frame_hz + device.dark_counts_hz,
            sensor.exposure_s,
            sensor.avalanche_effects,
            device.avalanches,
        )
    return mean, variance


def _check_sensor(sensor: Sensor) -> None:
    if not isinstance(sensor, Sensor):
        raise TypeError(f"sensor: {sensor!r} is no Sensor; give one, such as preset('spadcam')")
