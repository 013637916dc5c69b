"""Array of CTIA pixels as an image sensor: from the radiance of a scene to volts.

    photocurrent = q · (photons per second on the diode) · quantum efficiency
    reading      = discharge after the exposure + noise, V

With a leaking floating gate, each frame is one frame period older than the one before. Over the
pixels, offset and gain in decibels are normal (§3.2.4), the factor on the dark current is
log-normal with mean 1 (an assumption; the dissertation measured single pixels).

**Noise**: dark shot noise is that of two opposite Poisson currents of the junction
(`junction_currents`), and the thermal noise of the shunt, variance 2·k·T·t/R (C²), at the bias in
the middle of the discharge.

Source: dissertation, Chapter 3, for the pixel; the array is an extension. Approximations:
`docs/theory/ctia.md`.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field
from scipy.special import ndtr

from megalopta.core.arrays import Floats, Mask
from megalopta.core.record import Record
from megalopta.sensor.ctia import photodiode
from megalopta.sensor.ctia.bias import Bias, FixedBias, drift_rate, trimmed_bias
from megalopta.sensor.ctia.integration import Pixel, discharge, gain_from_db, reverse_bias, start
from megalopta.sensor.optics import PixelOptics, detected_rate
from megalopta.sensor.sampling.streams import generator, light_key, pixel_normals, sensor_stream


class CtiaNoise(Record):
    """Noise terms of a CTIA reading."""

    photon_shot: bool = True
    """Photon shot noise."""
    dark_shot: bool = True
    """Noise of the dark diode: shot noise of its junction, thermal noise of its shunt."""
    reset: bool = True
    """kTC noise of resetting the capacitor; off: the reset level is subtracted."""
    read_noise_v: Annotated[float, Field(ge=0)] = 0.0
    """Standard deviation of everything after the pixel (V); 0: none."""


def draw_noise(
    rng: np.random.Generator, noise: CtiaNoise, pixel: Pixel, photocurrent_a: Floats, time_s: float
) -> Floats:
    """Draw the deviation of readings from the noise-free discharge, V.

    `photocurrent_a`: A, one per pixel; `time_s`: since reset.
    """
    elapsed, bias = _halfway(pixel, photocurrent_a, time_s)
    volts = np.zeros(np.broadcast_shapes(np.shape(photocurrent_a), elapsed.shape))
    if noise.photon_shot:
        volts += poisson_charge(rng, photocurrent_a * elapsed) / pixel.capacitance_f
    if noise.dark_shot:
        diode = pixel.diode
        time = np.asarray(pixel.dark_scale) * elapsed
        reverse, forward = photodiode.junction_currents(diode, bias)
        charge = poisson_charge(rng, reverse * time)
        charge -= poisson_charge(rng, forward * time)
        if diode.shunt_ohm is not None:
            conductance = diode.shunt_s * np.asarray(pixel.dark_scale)
            variance = 2 * photodiode.BOLTZMANN_J_K * diode.temperature_k * conductance * elapsed
            charge += rng.normal(0.0, np.sqrt(np.broadcast_to(variance, charge.shape)))
        volts += charge / pixel.capacitance_f
    normal = reset_variance(noise, pixel) + noise.read_noise_v**2
    if normal > 0:
        volts += rng.normal(0.0, np.sqrt(normal), volts.shape)
    return volts


def noise_variance(noise: CtiaNoise, pixel: Pixel, photocurrent_a: Floats, time_s: float) -> Floats:
    """Variance of `draw_noise`, V²; its mean is 0."""
    elapsed, bias = _halfway(pixel, photocurrent_a, time_s)
    equivalent = photodiode.noise_current(pixel.diode, bias, pixel.dark_scale)
    shot = noise.photon_shot * photocurrent_a + noise.dark_shot * equivalent
    charge = photodiode.ELEMENTARY_CHARGE_C * shot * elapsed
    return np.asarray(
        charge / pixel.capacitance_f**2 + reset_variance(noise, pixel) + noise.read_noise_v**2
    )


def _halfway(pixel: Pixel, photocurrent_a: Floats, time_s: float) -> tuple[Floats, Floats]:
    """Time during which the output moves, s, and the reverse bias in the middle of it, V."""
    wait, bias = start(pixel, photocurrent_a)
    elapsed = np.maximum(time_s - wait, 0.0)
    middle = np.where(elapsed > 0, time_s - elapsed / 2, 0.0)
    discharged = discharge(pixel, photocurrent_a, time_s) / 2
    return elapsed, np.maximum(reverse_bias(pixel, middle, discharged), bias)


def poisson_charge(rng: np.random.Generator, charge: Floats) -> Floats:
    """Charge of a Poisson number of electrons minus its mean, C."""
    electrons = charge / photodiode.ELEMENTARY_CHARGE_C
    return np.asarray(photodiode.ELEMENTARY_CHARGE_C * (rng.poisson(electrons) - electrons))


def reset_variance(noise: CtiaNoise, pixel: Pixel) -> float:
    """Variance of the reset voltage, kT/C, V²."""
    kelvin = pixel.diode.temperature_k
    return noise.reset * photodiode.BOLTZMANN_J_K * kelvin / pixel.capacitance_f


class CtiaSensor(PixelOptics, frozen=True):
    """Array of photodiodes, each with a CTIA, behind a lens."""

    unit: ClassVar[str] = "electrons"
    """Unit of its readings in comparisons with other sensors."""

    kind: Literal["ctia"] = "ctia"
    """Kind of image sensor."""
    fill_factor: Annotated[float, Field(gt=0, le=1)] = 1.0
    """Light-sensitive fraction of the pixel's area (0 to 1)."""
    diode: photodiode.Photodiode
    """Dark current of the photodiode."""
    capacitance_f: Annotated[float, Field(gt=0)] = 10e-12
    """Integration capacitor (F)."""
    swing_v: Annotated[float, Field(gt=0)] = 3.3
    """Discharge at which the output reaches its lower rail and the pixel saturates (V)."""
    gain_db: Annotated[float, Field(ge=20, le=200)] = 130.0
    """Mean open-loop gain of the amplifiers (dB)."""
    gain_sigma_db: Annotated[float, Field(ge=0)] = 0.0
    """Standard deviation of the gain over the pixels (dB)."""
    offset_v: float = 0.0
    """Mean input offset of the amplifiers (V); positive: reverse bias."""
    offset_sigma_v: Annotated[float, Field(ge=0)] = 0.0
    """Standard deviation of the offset over the pixels (V)."""
    residue_share: Annotated[float, Field(ge=0, le=0.5, exclude_if=lambda share: share == 0)] = 0.0
    """Share of a reading that stays on the capacitor after the reset (0: complete)."""
    dark_sigma: Annotated[float, Field(ge=0)] = 0.0
    """Relative standard deviation of the dark current over the pixels at equal bias."""
    bias: Annotated[Bias, Field(discriminator="kind")] = FixedBias()
    """Circuit that sets the reverse bias of the diodes."""
    noise: CtiaNoise = CtiaNoise()
    """Noise of its readings."""
    device_seed: int = 0
    """Device seed: fixes offset, gain and dark current of every pixel."""


def pixels(sensor: CtiaSensor, shape: tuple[int, int]) -> Pixel:
    """Pixels of a device at its first frame, with its fixed pattern."""
    offset = sensor.offset_v + sensor.offset_sigma_v * _normal(sensor, shape, "offset")
    gain_db = sensor.gain_db + sensor.gain_sigma_db * _normal(sensor, shape, "gain")
    dark, log_variance = _normal(sensor, shape, "dark current"), np.log1p(sensor.dark_sigma**2)
    return Pixel(
        diode=sensor.diode,
        capacitance_f=sensor.capacitance_f,
        swing_v=sensor.swing_v,
        gain=gain_from_db(gain_db),
        bias_v=trimmed_bias(sensor.bias, offset),
        drift_v_s=drift_rate(sensor.bias),
        dark_scale=np.exp(np.sqrt(log_variance) * dark - log_variance / 2),
    )


def _normal(sensor: CtiaSensor, shape: tuple[int, int], purpose: str) -> Floats:
    return pixel_normals(shape, sensor.device_seed, f"ctia {purpose}")


CTIA_PRESETS = CtiaSensor.presets(Path(__file__).with_name("presets.yaml"))
PHOTODIODES = {name.removeprefix("ctia_"): sensor.diode for name, sensor in CTIA_PRESETS.items()}


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
    return photodiode.ELEMENTARY_CHARGE_C * detected_rate(radiance, bands_nm, sensor)


def expose_photocurrent(
    photocurrent_a: ArrayLike,
    sensor: CtiaSensor,
    *,
    seed: int,
    stream: str | int,
    first_frame: int = 0,
    frame_period_s: float | None = None,
    former_v: ArrayLike = 0.0,
) -> CtiaExposure:
    """Read frames of known photocurrent, (T, H, W) in A; parameters as for `expose`.

    `former_v` (H, W): reading before the first frame, of which a part stays (`residue_share`).
    """
    light = _checked(photocurrent_a)
    named = sensor_stream(stream, sensor, np.zeros((1, 1)))
    volts, saturated = np.empty_like(light), np.empty(light.shape, np.bool_)
    for index, now in enumerate(_aging(sensor, light.shape, first_frame, frame_period_s)):
        rng = generator(seed, "ctia exposure", named, light_key(light[index]), first_frame + index)
        discharged = discharge(now, light[index], sensor.exposure_s)
        discharged += sensor.residue_share * np.asarray(former_v)
        noise = draw_noise(rng, sensor.noise, now, light[index], sensor.exposure_s)
        volts[index] = discharged + noise
        saturated[index] = (volts[index] >= sensor.swing_v) | (discharged >= sensor.swing_v)
        volts[index][saturated[index]] = sensor.swing_v
        former_v = volts[index]
    return CtiaExposure(volts, saturated)


def volt_moments(
    photocurrent_a: ArrayLike,
    sensor: CtiaSensor,
    first_frame: int = 0,
    frame_period_s: float | None = None,
    former_v: ArrayLike = 0.0,
) -> tuple[Floats, Floats]:
    """Mean (V) and variance (V²) of readings, each (T, H, W); parameters as `expose_photocurrent`.

    The noise of a pixel near its rail is approximated as normal; it holds 1e8 electrons there.
    """
    light, share = _checked(photocurrent_a), sensor.residue_share
    moments, former = np.empty((2, *light.shape)), (np.asarray(former_v), np.zeros(()))
    for index, now in enumerate(_aging(sensor, light.shape, first_frame, frame_period_s)):
        free = discharge(now, light[index], sensor.exposure_s) + share * former[0]
        noise = noise_variance(sensor.noise, now, light[index], sensor.exposure_s)
        noise += share**2 * former[1]
        depth, sigma = sensor.swing_v - free, np.sqrt(noise)
        below = np.divide(depth, sigma, out=np.full_like(free, np.inf), where=sigma > 0)
        chance, density = ndtr(below), np.exp(-(below**2) / 2) / np.sqrt(2 * np.pi)
        lost = sigma * density - depth * (1 - chance)
        square = noise * chance - depth * sigma * density + depth**2 * (1 - chance)
        is_held = free >= sensor.swing_v
        moments[:, index] = (
            np.where(is_held, sensor.swing_v, free - lost),
            np.where(is_held, 0.0, np.maximum(square - lost**2, 0.0)),
        )
        former = moments[0, index], moments[1, index]
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
    return mean, variance * (sensor.capacitance_f / photodiode.ELEMENTARY_CHARGE_C) ** 2


def reading_electrons(volts: photodiode.Reals, sensor: CtiaSensor) -> Floats:
    """Electrons behind readings (V) of any shape, including those of the dark current."""
    return np.asarray(volts * sensor.capacitance_f / photodiode.ELEMENTARY_CHARGE_C)


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
