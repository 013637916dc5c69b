"""Exposures of a sensor for users: readings of a scene, or of known detection rates.

The exposure of a SPAD array, step by step, is `spad.array`; that of CTIA pixels, which integrate a
photocurrent, `ctia.model`.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from megalopta.sensor import expectations
from megalopta.sensor.contrast import model as contrast
from megalopta.sensor.ctia import model as ctia
from megalopta.sensor.ctia.photodiode import ELEMENTARY_CHARGE_C
from megalopta.sensor.frame import exposure as frame
from megalopta.sensor.frame.model import FrameSensor
from megalopta.sensor.image_sensors import ImageSensor, detected_hz, sensor_named
from megalopta.sensor.quantities import Events, Exposure
from megalopta.sensor.sampling.streams import Draw
from megalopta.sensor.spad.array import Reading, expose_frames
from megalopta.sensor.spad.model import Sensor


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
    """Simulate a sensor's readings of a scene: counts, electrons, or net contrast events.

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
    if isinstance(sensor, str):
        sensor = sensor_named(sensor)
    rate_hz = detected_hz(radiance, bands_nm, sensor)
    draw = Draw(seed, stream, first_frame, frame_period_s)
    exposure: Exposure
    exposure, _ = draw_frames(rate_hz, sensor, draw)
    if not expectation:
        return exposure
    times = first_frame, frame_period_s
    stated = expectations.expectation(radiance, bands_nm, sensor, *times, detections_hz=rate_hz)
    return replace(exposure, expectation=stated)


def draw_frames(
    rate_hz: ArrayLike,
    sensor: ImageSensor,
    draw: Draw,
    reading: Reading = "counts",
    state: Any = None,
    *,
    is_running: bool = False,
) -> tuple[Any, Any]:
    """Draw a reading of any sensor, and the state of its pixels that the next frames start from.

    `rate_hz`: as `detected_hz`, or in parts where a kind takes them; `state`: None at first.
    Arrays without single events have "counts" only.
    """
    if isinstance(sensor, Sensor):
        return expose_frames(rate_hz, sensor, draw, reading, is_running=is_running, state=state)
    if isinstance(sensor, contrast.ContrastSensor):
        return contrast.expose_frames(rate_hz, sensor, draw, reading, state)
    if isinstance(sensor, FrameSensor):
        return frame.expose_frames(np.asarray(rate_hz), sensor, draw, state)
    light_a = ELEMENTARY_CHARGE_C * np.asarray(rate_hz)
    former_v = 0.0 if state is None else state
    read = ctia.expose_photocurrent(light_a, sensor, **draw._asdict(), former_v=former_v)
    electrons = ctia.reading_electrons(read.volts, sensor).astype(np.float32)
    return Exposure(electrons, read.saturated), read.volts[-1] if len(read.volts) else state


def expose_rate(
    detections_hz: ArrayLike,
    sensor: Sensor,
    *,
    seed: int,
    stream: str | int,
    first_frame: int = 0,
    frame_period_s: float | None = None,
    free_running: bool = False,
) -> Exposure:
    """Draw the counts of frames of known detection rate; other parameters as for `expose`.

    Parameters
    ----------
    detections_hz : (T, H, W) or (T, S, H, W) array
        Hz, constant over an exposure or in S equal parts of it; `detection_rate`
        gives that of a scene.
    free_running : bool
        Exposures follow each other without a gap and pixels keep their state, from the first frame
        of this call on. Frames then depend on those before.
    """
    draw = Draw(seed, stream, first_frame, frame_period_s)
    exposure: Exposure
    exposure, _ = expose_frames(detections_hz, sensor, draw, "counts", is_running=free_running)
    return exposure


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
    if sensor.counter.kind != "analog":
        raise ValueError("counter.kind: 'digital'; only an analog counter is read by an ADC")
    draw = Draw(seed, stream, first_frame)
    codes: NDArray[np.uint16]
    codes, _ = expose_frames(detections_hz, sensor, draw, "codes", together=together)
    return codes


def expose_binary(
    detections_hz: ArrayLike,
    sensor: Sensor,
    *,
    seed: int,
    stream: str | int,
    first_frame: int = 0,
    frame_period_s: float | None = None,
    free_running: bool = False,
) -> NDArray[np.uint8]:
    """Draw binary frames, packed (T, H, ceil(W/8)) uint8; as `expose_rate`.

    The bit is 1 with probability p = 1 − exp(−r·T) from a live start; mean p, variance p·(1−p).
    Dead time and afterpulses act only after the first event; crosstalk adds arrivals to r·T
    (`effects.crosstalk`). With a gate, T is the open time; if light changes within the
    exposure, r is its mean over that time. Bits are packed as visionsim does: `np.packbits` along
    the width, the last byte of a row padded with zeros. Raises ValueError as `expose_rate`, or as
    `check_binary`.
    """
    check_binary(sensor)
    draw = Draw(seed, stream, first_frame, frame_period_s)
    bits: NDArray[np.uint8]
    bits, _ = expose_frames(detections_hz, sensor, draw, "bits", is_running=free_running)
    return bits


def expose_events(
    detections_hz: ArrayLike,
    sensor: Sensor | contrast.ContrastSensor,
    *,
    seed: int,
    stream: str | int,
    first_frame: int = 0,
    frame_period_s: float | None = None,
    free_running: bool = False,
) -> Events:
    """Draw the time and pixel of every avalanche, instead of counts.

    An event-based array reports every avalanche and has no counter; its jitter scatters the time
    stamps. Parameters, and errors, are those of `expose_rate`. A contrast sensor, which always
    runs, takes light at the ends of parts (`contrast.model.expose_frames`).
    """
    draw = Draw(seed, stream, first_frame, frame_period_s)
    events: Events
    events, _ = draw_frames(detections_hz, sensor, draw, "events", is_running=free_running)
    return events


def check_binary(sensor: Sensor) -> None:
    """Raise ValueError if a sensor has no binary frames, as its chip adds them."""
    if sensor.counter.sums > 1:
        raise ValueError(f"counter.sums: {sensor.counter.sums}; give 1 for the binary frames")
