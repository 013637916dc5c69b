"""Array of CTIA pixels as an image sensor: from the radiance of a scene to volts.

    photocurrent = q · (photons per second on the diode) · quantum efficiency
    reading      = discharge after the exposure + noise, V

The radiance of a frame holds for the whole exposure. Every frame has its own random stream, named
by seed, stream, sensor, light and frame number. With a leaking floating gate, each frame is one
frame period older than the one before.

Source: dissertation, Chapter 3, for the pixel; the array is an extension.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr

from megalopta.core.arrays import Floats, Mask
from megalopta.sensor.ctia.integration import Pixel, discharge
from megalopta.sensor.ctia.model import CtiaSensor, pixels
from megalopta.sensor.ctia.noise import draw_noise, noise_variance
from megalopta.sensor.ctia.photodiode import ELEMENTARY_CHARGE_C, Reals
from megalopta.sensor.optics.pixels import check_brightness, detected_rate
from megalopta.sensor.sampling.streams import generator, light_key, sensor_stream

# In swings: electrons of a saturated pixel are tracked up to here.
_FAR = 1e3


@dataclass(frozen=True, eq=False)
class CtiaExposure:
    """Frames as read by the array."""

    volts: Floats
    """(T, H, W) discharge of each pixel; the swing if saturated. Noise can make it negative."""
    saturated: Mask
    """(T, H, W) True where the output was at its lower rail: the reading is a lower bound"""


def photocurrent(radiance: ArrayLike, bands_nm: ArrayLike, sensor: CtiaSensor) -> Floats:
    """Photocurrent of every pixel, (T, H, W) in A; parameters as for `expose`."""
    rate = detected_rate(radiance, bands_nm, sensor)
    return ELEMENTARY_CHARGE_C * check_brightness(rate, sensor.exposure_s)


def expose_photocurrent(
    photocurrent_a: ArrayLike,
    sensor: CtiaSensor,
    *,
    seed: int,
    stream: str | int,
    first_frame: int = 0,
    frame_period_s: float | None = None,
) -> CtiaExposure:
    """Read frames of known photocurrent, (T, H, W) in A; parameters as for `expose`."""
    light = _checked(photocurrent_a)
    named = sensor_stream(stream, sensor, np.zeros((1, 1)))
    volts, saturated = np.empty_like(light), np.empty(light.shape, np.bool_)
    for index, now in enumerate(_aging(sensor, light.shape, first_frame, frame_period_s)):
        rng = generator(seed, "ctia exposure", named, light_key(light[index]), first_frame + index)
        discharged = discharge(now, light[index], sensor.exposure_s)
        noise = draw_noise(rng, sensor.noise, now, light[index], sensor.exposure_s)
        volts[index] = discharged + noise
        saturated[index] = (volts[index] >= sensor.swing_v) | (discharged >= sensor.swing_v)
    volts[saturated] = sensor.swing_v
    return CtiaExposure(volts, saturated)


def volt_moments(
    photocurrent_a: ArrayLike,
    sensor: CtiaSensor,
    first_frame: int = 0,
    frame_period_s: float | None = None,
) -> tuple[Floats, Floats]:
    """Mean (V) and variance (V²) of readings, each (T, H, W); parameters as `expose_photocurrent`.

    The noise of a pixel near its rail is approximated as normal; it holds 1e8 electrons there.
    """
    light = _checked(photocurrent_a)
    moments = np.empty((2, *light.shape))
    for index, now in enumerate(_aging(sensor, light.shape, first_frame, frame_period_s)):
        free = discharge(now, light[index], sensor.exposure_s)
        noise = noise_variance(sensor.noise, now, light[index], sensor.exposure_s)
        moments[:, index] = _held_at(sensor.swing_v, free, noise)
    return moments[0], moments[1]


def electron_moments(
    photocurrent_a: ArrayLike,
    sensor: CtiaSensor,
    first_frame: int = 0,
    frame_period_s: float | None = None,
) -> tuple[Floats, Floats]:
    """Mean and variance (T, H, W) of electrons, also of saturated pixels; as `volt_moments`."""
    light = _checked(photocurrent_a)
    mean, variance = np.empty_like(light), np.empty_like(light)
    arrivals = sensor.noise.model_copy(update={"reset": False, "read_noise_v": 0.0})
    for index, now in enumerate(_aging(sensor, light.shape, first_frame, frame_period_s)):
        # for pixels within their swing, discharges are faster to compute with it
        full = discharge(now, light[index], sensor.exposure_s) >= sensor.swing_v
        for pixel, which in ((now, ~full), (replace(now, swing_v=_FAR * now.swing_v), full)):
            if which.any():
                volts = discharge(pixel, light[index], sensor.exposure_s)
                noise = noise_variance(arrivals, pixel, light[index], sensor.exposure_s)
                mean[index][which] = reading_electrons(volts, sensor)[which]
                variance[index][which] = noise[which]
    return mean, variance * (sensor.capacitance_f / ELEMENTARY_CHARGE_C) ** 2


def reading_electrons(volts: Reals, sensor: CtiaSensor) -> Floats:
    """Electrons behind readings (V) of any shape, including those of the dark current."""
    return np.asarray(volts * sensor.capacitance_f / ELEMENTARY_CHARGE_C)


def _held_at(rail_v: float, free_v: Floats, noise: Floats) -> tuple[Floats, Floats]:
    """Mean and variance of normal numbers clipped at a rail, where noise-free values stay."""
    sigma = np.sqrt(noise)
    below = np.divide(rail_v - free_v, sigma, out=np.full_like(free_v, np.inf), where=sigma > 0)
    chance = ndtr(below)
    density = np.exp(-(below**2) / 2) / np.sqrt(2 * np.pi)
    lost = sigma * density - np.where(chance < 1, (rail_v - free_v) * (1 - chance), 0.0)
    square = noise * chance - (rail_v - free_v) * sigma * density
    square += np.where(chance < 1, (rail_v - free_v) ** 2 * (1 - chance), 0.0)
    is_held = free_v >= rail_v
    return (
        np.where(is_held, rail_v, free_v - lost),
        np.where(is_held, 0.0, np.maximum(square - lost**2, 0.0)),
    )


def _aging(
    sensor: CtiaSensor, shape: tuple[int, ...], first_frame: int, frame_period_s: float | None
) -> Iterator[Pixel]:
    """Pixels of a device at each frame."""
    array = pixels(sensor, (shape[1], shape[2]))
    period = frame_period_s or sensor.exposure_s
    for frame in range(first_frame, first_frame + shape[0]):
        yield replace(array, bias_v=array.bias_v + array.drift_v_s * frame * period)


def _checked(photocurrent_a: ArrayLike) -> Floats:
    light = np.asarray(photocurrent_a, np.float64)
    if light.ndim != 3 or not np.all((light >= 0) & (light < np.inf)):
        raise ValueError(
            f"photocurrent_a: shape {light.shape}; give (frames, rows, columns) of finite currents "
            "that are not negative (A)"
        )
    return light
