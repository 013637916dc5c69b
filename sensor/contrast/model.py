"""Event camera: pixels that report changes of the logarithm of light, photon by photon.

    λ(t)            electrons per second: detected photons and dark current
    τ·dV/dt         ln λ − V + noise: a photoreceptor of one pole, τ = max(fastest_s, charge_e/λ)
    ON, OFF         V rises by θ_on, or falls by θ_off, from the reference, which becomes V

**Noise** is that of the arrivals: by Campbell's theorem, one pole of τ leaves a variance of 1/(2λτ)
of V, which moves as an Ornstein-Uhlenbeck process about its mean. In dim light, where
τ = charge_e/λ, this is 1/(2·charge_e) whatever the light (Graça and Delbruck, arXiv 2109.08640); in
bright light it falls. A photoreceptor whose feedback transistor has the shot noise of the same
current, too, has a `noise_factor` of 2: kT/C. It is Gaussian, which holds for some ten electrons
within τ or more, and small against 1.

**Light** within a frame is given at the ends of its parts. Between them ln λ is straight, and goes
on from where the previous frame ended, so there are no steps, which would make bursts of events.
With constant light in a frame, ln λ moves there from that of the previous frame.

**References** leak, so that light that does not change makes ON events at `leak_hz`. During the
refractory period after an event, the reference follows V. At first V is stationary, and the
reference equal to it, or, with a leak, anywhere on its way to the next ON event.

Events do not depend on time steps (`passage`). Draws of a frame are a function of seed, stream,
sensor, light and frame number; the state continues from frame to frame.

Not modeled: limits of the readout, its arbitration and jitter; several poles; photocurrent that
leaks into references (Nozaki and Delbruck 2017); thresholds that depend on temperature.
"""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from megalopta.core.arrays import Floats, Ints
from megalopta.sensor.contrast.passage import passage_tables, run_pixels
from megalopta.sensor.optics import Efficiency, PixelOptics
from megalopta.sensor.quantities import Exposure, histogram, in_order_of_time, joined
from megalopta.sensor.sampling import streams

_ROWS_AT_ONCE, _FEW_PIXELS = 16, 2**12
"""Rows of a thread's task; fewer pixels are drawn in turn"""
_QUIET = 5.0
"""Distance from a threshold at which noise rarely passes it, σ"""


class ContrastSensor(PixelOptics, frozen=True):
    """Array of pixels that report changes of contrast, behind a lens."""

    unit: ClassVar[str] = "events"
    """Unit of its readings: ON minus OFF events of a frame."""

    kind: Literal["contrast"] = "contrast"
    """Kind of image sensor."""
    exposure_s: Annotated[float, Field(gt=0)]
    """Time of a frame (s), which events fill without a gap."""
    efficiency: Efficiency
    """Quantum efficiency over wavelength: electrons per photon on the light-sensitive area."""
    dark_e_s: Annotated[float, Field(ge=1e-3, le=1e9)]
    """Dark current of a pixel (electrons per second)."""
    threshold_on: Annotated[float, Field(ge=0.005, le=5)]
    """Mean rise of ln λ from the reference that makes an ON event; 0.1 is 10.5 %."""
    threshold_off: Annotated[float, Field(ge=0.005, le=5)]
    """Mean fall of ln λ from the reference that makes an OFF event."""
    threshold_sigma: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Standard deviation of either threshold over the pixels."""
    fastest_s: Annotated[float, Field(gt=0, le=10)]
    """Time constant of the photoreceptor in bright light, set by its amplifier (s)."""
    charge_e: Annotated[float, Field(ge=10, le=1e9)]
    """Electrons that move V by 1. They are the capacitance of the photodiode's node, over the gain
    of its amplifier, times kT/q, over q; in dim light the time constant is this over λ."""
    noise_factor: Annotated[float, Field(ge=0, le=100)] = 1.0
    """Variance of V over that of the arrivals; 0: no noise."""
    leak_hz: Annotated[float, Field(ge=0, le=1e4)] = 0.0
    """ON events per second of a pixel in light that does not change."""
    refractory_s: Annotated[float, Field(ge=0, le=10)] = 0.0
    """Time after an event during which the reference follows V (s)."""
    device_seed: int = 0
    """Device seed: fixes the thresholds of every pixel."""

    def time_constant_s(self, rate_hz: Floats) -> Floats:
        """Time constant of the photoreceptor at λ (Hz), s."""
        return np.maximum(self.fastest_s, self.charge_e / rate_hz)

    def noise_variance(self, rate_hz: Floats) -> Floats:
        """Variance of V at λ (Hz)."""
        return self.noise_factor / (2 * rate_hz * self.time_constant_s(rate_hz))

    def thresholds(self, shape: tuple[int, int]) -> Floats:
        """Thresholds of every pixel, ON and OFF, (2, rows, columns)."""
        means = np.array([self.threshold_on, self.threshold_off])[:, None, None]
        names = "contrast ON", "contrast OFF"
        spread = np.array([streams.pixel_normals(shape, self.device_seed, name) for name in names])
        return np.maximum(means + self.threshold_sigma * spread, 0.2 * means)  # least thresholds


def expose_frames(
    detections_hz: ArrayLike,
    sensor: ContrastSensor,
    draw: streams.Draw,
    reading: str = "counts",
    state: Floats | None = None,
) -> tuple[Any, Floats | None]:
    """Draw the `Events` of frames of known light, or an `Exposure` of "counts": ON minus OFF.

    Raises ValueError if the light is not finite, or a frame holds too many events.

    Parameters
    ----------
    detections_hz : (T, H, W) or (T, S + 1, H, W)
        Detected photons per second: constant in a frame, or at the ends of S equal parts of it.
    state
        The second value returned, of the frames before, (4, H, W): ln λ, V, the reference, and the
        rest of the refractory period (s). Default: pixels start in the first light.
    """
    if abs((draw.frame_period_s or sensor.exposure_s) / sensor.exposure_s - 1) > 1e-9:
        raise ValueError(
            f"exposure_s: {sensor.exposure_s:g} s, but frames take {draw.frame_period_s:g} s, "
            "which events fill without a gap; make them equal"
        )
    lights = _log_light(detections_hz, sensor, state)
    frames, _, rows, columns = lights.shape
    thresholds = sensor.thresholds((rows, columns))
    stream, drawn = streams.sensor_stream(draw.stream, sensor, np.zeros((1, 1))), []
    for number, light in enumerate(lights, draw.first_frame):
        key = draw.seed, "contrast", stream, streams.light_key(np.exp(light)), number
        state = _start(light[0], sensor, streams.generator(*key)) if state is None else state
        times_s, codes, state = _draw_frame(light, thresholds, sensor, key, state)
        drawn.append(in_order_of_time(times_s, codes))
    events = joined(drawn, (frames, rows, columns), draw.first_frame)
    is_on = (events.pixel & 1).astype(np.bool_)
    events = replace(events, pixel=events.pixel // np.uint32(2), polarity=is_on)
    if reading == "events":
        return events, state
    net = histogram(events).astype(np.float32)
    return Exposure(net, np.zeros(net.shape, np.bool_)), state


def moments(detections_hz: ArrayLike, sensor: ContrastSensor, state: Floats | None) -> Floats:
    """Mean and variance of arrivals, mean and variance of readings, (4, T, H, W).

    Those of readings are not exact. The mean is that of a pixel without noise, delay and refractory
    period: the change of ln λ over the threshold in that direction, and the leak. The variance is
    that of the noise at both ends, and of counting whole thresholds from any reference. Parameters
    are those of `expose_frames`.
    """
    lights = _log_light(detections_hz, sensor, state)
    rise, rate_hz = lights[:, -1] - lights[:, 0], np.exp(lights.mean(axis=1))
    on, off = sensor.thresholds(rise.shape[1:])
    threshold: Floats = np.where(rise > 0, on, off)
    net = rise / threshold + sensor.leak_hz * sensor.exposure_s
    apart = -np.expm1(-sensor.exposure_s / sensor.time_constant_s(rate_hz)) / threshold**2
    variance = 2 * sensor.noise_variance(rate_hz) * apart + net % 1 * (1 - net % 1)
    electrons = np.exp(lights).mean(axis=1) * sensor.exposure_s
    return np.array([electrons, electrons, net, variance])


def _log_light(detections_hz: ArrayLike, sensor: ContrastSensor, state: Floats | None) -> Floats:
    """Return ln λ at the ends of parts, (T, S + 1, H, W); a frame starts where the last one ended.

    Raises ValueError if the light is not finite, or of another shape.
    """
    rates = np.asarray(detections_hz, np.float64)
    if rates.ndim not in (3, 4) or not np.all((rates >= 0) & (rates < np.inf)):
        raise ValueError(
            f"detections_hz: shape {rates.shape}; give (frames, rows, columns), or with ends of "
            "parts (frames, parts + 1, rows, columns), finite and not negative"
        )
    light = np.log(sensor.dark_e_s + (rates if rates.ndim == 4 else rates[:, None]))
    ends = light[:, -max(light.shape[1] - 1, 1) :]
    first = light[:1, 0] if state is None else state[:1]
    return np.concatenate([np.concatenate([first, ends[:-1, -1]])[:, None], ends], axis=1)


def _start(light: Floats, sensor: ContrastSensor, rng: np.random.Generator) -> Floats:
    """Draw the first state: V is stationary, references anywhere on the way to a leak event."""
    sigma = np.sqrt(sensor.noise_variance(np.exp(light)))
    output = light + sigma * rng.standard_normal(light.shape)
    threshold = sensor.thresholds(light.shape)[0]
    way = np.maximum(threshold - _QUIET * sigma, 0.0) * (sensor.leak_hz > 0)
    reference = output - way * rng.random(light.shape)
    return np.array([light, output, reference, np.zeros(light.shape)])


def _draw_frame(
    light: Floats, thresholds: Floats, sensor: ContrastSensor, key: Any, state: Floats
) -> tuple[Floats, Ints, Floats]:
    """Return times (s), 2 · pixel + ON of the events of a frame, and the state after it."""
    names = "fastest_s", "charge_e", "noise_factor", "leak_hz", "refractory_s"
    pixel = tuple(getattr(sensor, name) for name in names)
    part_s, (rows, columns) = sensor.exposure_s / (len(light) - 1), light.shape[1:]
    starts, after, pieces = range(0, rows, _ROWS_AT_ONCE), np.array(state), {}
    most = 50_000_000 // len(starts)  # events; 2 GB while sorted

    def draw_rows(row: int) -> None:
        images = light, thresholds, state
        blocks = [np.array(image[:, row : row + _ROWS_AT_ONCE]) for image in images]
        flat = [block.reshape(len(block), -1) for block in blocks]
        rng = streams.generator(*key, row)
        times, codes = run_pixels(rng, pixel, passage_tables(), part_s, *flat, most)
        if times.size >= most:
            raise ValueError(
                f"frame {key[-1]}: over {most} events in {_ROWS_AT_ONCE} rows, as noise passes "
                f"threshold_on {sensor.threshold_on:g}; raise it, charge_e or refractory_s"
            )
        pieces[row] = times, codes + 2 * row * columns
        after[:, row : row + _ROWS_AT_ONCE] = blocks[2]

    streams.over_frames(draw_rows, starts, rows * columns < _FEW_PIXELS)
    times, codes = (np.concatenate(parts) for parts in zip(*map(pieces.get, starts), strict=True))
    return times, codes, after


CONTRAST_PRESETS = ContrastSensor.presets(Path(__file__).with_name("presets.yaml"))
