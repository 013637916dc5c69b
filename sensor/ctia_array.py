"""Array of CTIA pixels as an image sensor: from the radiance of a scene to volts.

    photocurrent = q · (photons per second on the diode) · quantum efficiency
    reading      = discharge after the exposure + noise, V

Offset, gain and dark current differ from pixel to pixel and are fixed by the device seed and the
pixel's row and column: the offset and the gain in decibels are normal (§3.2.4), the factor on the
dark current is log-normal with mean 1 (ours; the dissertation measured single pixels). What of the
offset is left as bias depends on how the bias is set (`ctia_bias`).

The radiance of a frame holds for the whole exposure. Every frame has its own random stream, named
by seed, sequence and frame number. With a floating gate that leaks, every frame is that much older
than the one before.

Source: dissertation, Chapter 3, for the pixel; the array is ours.
"""

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel, Field
from scipy.special import ndtri

from megalopta.sensor.ctia_bias import Bias, FixedBias, drift_rate, trimmed_bias
from megalopta.sensor.ctia_integration import Pixel, discharge, gain_from_db
from megalopta.sensor.ctia_noise import CtiaNoise, draw_noise
from megalopta.sensor.ctia_photodiode import ELEMENTARY_CHARGE_C, Floats, Photodiode, Reals
from megalopta.sensor.efficiency import Efficiency
from megalopta.sensor.exposure import detection_rate
from megalopta.sensor.model import Sensor
from megalopta.sensor.optics import Lens
from megalopta.sensor.randomness import generator, pixel_uniforms


class CtiaSensor(
    BaseModel, frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
):
    """An array of photodiodes, each with a CTIA, behind a lens."""

    name: Annotated[str, Field(min_length=1)]
    """What the sensor is called in files and reports."""
    source: str = ""
    """Where its figures come from."""
    pitch_m: Annotated[float, Field(gt=0)]
    """Distance between the centers of neighboring pixels (m); a pixel is pitch × pitch."""
    fill_factor: Annotated[float, Field(gt=0, le=1)] = 1.0
    """Light-sensitive fraction of the pixel's area (0 to 1)."""
    exposure_s: Annotated[float, Field(gt=0)]
    """Time from reset to reading (s); also the time between frames."""
    lens: Lens = Lens()
    """The lens in front of it."""
    efficiency: Efficiency
    """Quantum efficiency: electrons per photon on the light-sensitive area, over wavelength."""
    diode: Photodiode
    """Current law of the photodiode in the dark."""
    capacitance_f: Annotated[float, Field(gt=0)] = 10e-12
    """Integration capacitor (F)."""
    swing_v: Annotated[float, Field(gt=0)] = 3.3
    """Discharge at which the output reaches its lower rail (V): the pixel is saturated."""
    gain_db: Annotated[float, Field(ge=20, le=200)] = 130.0
    """Mean open-loop gain of the amplifiers (dB)."""
    gain_sigma_db: Annotated[float, Field(ge=0)] = 0.0
    """Standard deviation of the gain over the pixels (dB)."""
    offset_v: float = 0.0
    """Mean input offset of the amplifiers, positive: reverse bias (V)."""
    offset_sigma_v: Annotated[float, Field(ge=0)] = 0.0
    """Standard deviation of the offset over the pixels (V)."""
    dark_sigma: Annotated[float, Field(ge=0)] = 0.0
    """Relative standard deviation of the dark current at equal bias over the pixels."""
    bias: Annotated[Bias, Field(discriminator="kind")] = FixedBias()
    """How the reverse bias of the diodes is set."""
    noise: CtiaNoise = CtiaNoise()
    """Which noise its readings have."""
    device_seed: int = 0
    """Which device of this kind: fixes offset, gain and dark current of every pixel."""


@dataclass(frozen=True, eq=False)
class CtiaExposure:
    """Frames as the array read them.

    Attributes
    ----------
    volts : (T, H, W) float64
        Discharge of each pixel; the swing where saturated. Noise can make it negative.
    expected : (T, H, W) float64
        The same without noise.
    saturated : (T, H, W) bool
        Where the output was at its lower rail: the reading is a lower bound.
    """

    volts: Floats
    expected: Floats
    saturated: NDArray[np.bool_]


def pixels(sensor: CtiaSensor, shape: tuple[int, int]) -> Pixel:
    """Every pixel of a device at its first frame, with its fixed pattern."""
    offset = sensor.offset_v + sensor.offset_sigma_v * _normal(sensor, shape, "offset")
    gain_db = sensor.gain_db + sensor.gain_sigma_db * _normal(sensor, shape, "gain")
    return Pixel(
        diode=sensor.diode,
        capacitance_f=sensor.capacitance_f,
        swing_v=sensor.swing_v,
        gain=gain_from_db(gain_db),
        bias_v=trimmed_bias(sensor.bias, offset),
        drift_v_s=drift_rate(sensor.bias),
        dark_scale=_log_normal(sensor.dark_sigma, _normal(sensor, shape, "dark current")),
    )


def photocurrent(radiance: ArrayLike, bands_nm: ArrayLike, sensor: CtiaSensor) -> Floats:
    """Photocurrent of every pixel, (T, H, W) in A; parameters as for `expose_ctia`."""
    optics = Sensor(
        name=sensor.name,
        pitch_m=sensor.pitch_m,
        fill_factor=sensor.fill_factor,
        exposure_s=sensor.exposure_s,
        lens=sensor.lens,
        efficiency=sensor.efficiency,
    )
    return ELEMENTARY_CHARGE_C * detection_rate(radiance, bands_nm, optics)


def expose_ctia(
    radiance: ArrayLike,
    bands_nm: ArrayLike,
    sensor: CtiaSensor,
    *,
    seed: int,
    sequence: str | int,
    first_frame: int = 0,
) -> CtiaExposure:
    """Read frames of a scene.

    Parameters
    ----------
    radiance : (T, H, W, B) array
        Band means, W·m⁻²·sr⁻¹·nm⁻¹.
    bands_nm : (B, 2) array
        Lower and upper edge of each band, nm.
    sensor : CtiaSensor
    seed : int
    sequence : str or int
        Name of what is drawn; a frame is a function of seed, sequence and its number.
    first_frame : int
        Number of the first of these frames in the sequence.

    Raises
    ------
    ValueError
        When the radiance is negative, not finite or of the wrong shape, or a band reaches outside
        the quantum efficiency curve.
    """
    light = photocurrent(radiance, bands_nm, sensor)
    return expose_photocurrent(light, sensor, seed=seed, sequence=sequence, first_frame=first_frame)


def expose_photocurrent(
    photocurrent_a: ArrayLike,
    sensor: CtiaSensor,
    *,
    seed: int,
    sequence: str | int,
    first_frame: int = 0,
) -> CtiaExposure:
    """Read frames whose photocurrent is known, (T, H, W) in A; as `expose_ctia`."""
    light = np.asarray(photocurrent_a, np.float64)
    if light.ndim != 3 or not np.all((light >= 0) & (light < np.inf)):
        raise ValueError(
            f"photocurrent_a: shape {light.shape}; give (frames, rows, columns) of finite currents "
            "that are not negative (A)"
        )
    volts, expected = np.empty_like(light), np.empty_like(light)
    array = pixels(sensor, (light.shape[1], light.shape[2]))
    for index, frame_light in enumerate(light):
        frame = first_frame + index
        now = _aged(array, frame * sensor.exposure_s)
        rng = generator(seed, "ctia exposure", sequence, frame)
        expected[index] = discharge(now, frame_light, sensor.exposure_s)
        noise = draw_noise(rng, sensor.noise, now, frame_light, sensor.exposure_s)
        volts[index] = expected[index] + noise
    saturated = (volts >= sensor.swing_v) | (expected >= sensor.swing_v)
    volts[saturated] = sensor.swing_v
    return CtiaExposure(volts, expected, saturated)


def reading_current(volts: Reals, sensor: CtiaSensor) -> Floats:
    """Current estimated from readings, dark current included, A."""
    return np.asarray(volts * sensor.capacitance_f / sensor.exposure_s)


def reading_electrons(volts: Reals, sensor: CtiaSensor) -> Floats:
    """Electrons behind readings, those of the dark current included."""
    return np.asarray(volts * sensor.capacitance_f / ELEMENTARY_CHARGE_C)


def _aged(array: Pixel, age_s: float) -> Pixel:
    bias = array.bias_v + array.drift_v_s * age_s
    return replace(array, bias_v=bias)


def _normal(sensor: CtiaSensor, shape: tuple[int, int], purpose: str) -> Floats:
    rank = pixel_uniforms(shape, sensor.device_seed, f"ctia {purpose}")
    # 0 is a possible rank and has no quantile; 1 is not
    return np.asarray(ndtri(np.maximum(rank, 2.0**-54)))


def _log_normal(relative_sigma: float, standard: Floats) -> Floats:
    log_variance = np.log1p(relative_sigma**2)
    return np.asarray(np.exp(np.sqrt(log_variance) * standard - log_variance / 2))
