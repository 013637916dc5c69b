"""Array of CTIA pixels as an image sensor: from the radiance of a scene to volts.

    photocurrent = q · (photons per second on the diode) · quantum efficiency
    reading      = discharge after the exposure + noise, V

The radiance of a frame holds for the whole exposure. Every frame has its own random stream, named
by seed, sequence and frame number. With a floating gate that leaks, every frame is that much older
than the one before.

Source: dissertation, Chapter 3, for the pixel; the array is ours.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from megalopta.sensor.ctia.integration import Pixel, discharge
from megalopta.sensor.ctia.model import CtiaSensor, pixels
from megalopta.sensor.ctia.noise import draw_noise, noise_variance
from megalopta.sensor.ctia.photodiode import ELEMENTARY_CHARGE_C, Floats, Reals
from megalopta.sensor.optics import check_brightness, detected_rate
from megalopta.sensor.sampling import generator


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


def photocurrent(radiance: ArrayLike, bands_nm: ArrayLike, sensor: CtiaSensor) -> Floats:
    """Photocurrent of every pixel, (T, H, W) in A; parameters as for `expose_ctia`."""
    rate = detected_rate(radiance, bands_nm, sensor)
    return ELEMENTARY_CHARGE_C * check_brightness(rate, sensor.exposure_s)


def expose_ctia(
    radiance: ArrayLike,
    bands_nm: ArrayLike,
    sensor: CtiaSensor,
    *,
    seed: int,
    sequence: str | int,
    first_frame: int = 0,
    frame_period_s: float | None = None,
) -> CtiaExposure:
    """Read frames of a scene; parameters as for `expose`, and one more.

    Parameters
    ----------
    frame_period_s : float, optional
        Time from one frame to the next; by default the exposure.

    Raises
    ------
    ValueError
        When the radiance is negative, not finite or of the wrong shape, or a band reaches outside
        the quantum efficiency curve.
    """
    light = photocurrent(radiance, bands_nm, sensor)
    return expose_photocurrent(
        light,
        sensor,
        seed=seed,
        sequence=sequence,
        first_frame=first_frame,
        frame_period_s=frame_period_s,
    )


def expose_photocurrent(
    photocurrent_a: ArrayLike,
    sensor: CtiaSensor,
    *,
    seed: int,
    sequence: str | int,
    first_frame: int = 0,
    frame_period_s: float | None = None,
) -> CtiaExposure:
    """Read frames whose photocurrent is known, (T, H, W) in A; as `expose_ctia`."""
    light = _checked(photocurrent_a)
    volts, expected = np.empty_like(light), np.empty_like(light)
    array = pixels(sensor, (light.shape[1], light.shape[2]))
    period = frame_period_s or sensor.exposure_s
    for index, frame_light in enumerate(light):
        frame = first_frame + index
        now = _aged(array, frame * period)
        rng = generator(seed, "ctia exposure", sequence, frame)
        expected[index] = discharge(now, frame_light, sensor.exposure_s)
        noise = draw_noise(rng, sensor.noise, now, frame_light, sensor.exposure_s)
        volts[index] = expected[index] + noise
    saturated = (volts >= sensor.swing_v) | (expected >= sensor.swing_v)
    volts[saturated] = sensor.swing_v
    return CtiaExposure(volts, expected, saturated)


def reading_moments(photocurrent_a: ArrayLike, sensor: CtiaSensor) -> tuple[Floats, Floats]:
    """Mean (V) and variance (V²) of readings at a photocurrent, (T, H, W) in A.

    All frames as the first one, before the gate has leaked; saturation is in the mean only.
    """
    light = _checked(photocurrent_a)
    array = pixels(sensor, (light.shape[1], light.shape[2]))
    mean = np.array([discharge(array, each, sensor.exposure_s) for each in light])
    variance = [noise_variance(sensor.noise, array, each, sensor.exposure_s) for each in light]
    return mean.reshape(light.shape), np.array(variance).reshape(light.shape)


def reading_current(volts: Reals, sensor: CtiaSensor) -> Floats:
    """Current estimated from readings, dark current included, A."""
    return np.asarray(volts * sensor.capacitance_f / sensor.exposure_s)


def reading_electrons(volts: Reals, sensor: CtiaSensor) -> Floats:
    """Electrons behind readings, those of the dark current included."""
    return np.asarray(volts * sensor.capacitance_f / ELEMENTARY_CHARGE_C)


def _aged(array: Pixel, age_s: float) -> Pixel:
    bias = array.bias_v + array.drift_v_s * age_s
    return replace(array, bias_v=bias)


def _checked(photocurrent_a: ArrayLike) -> Floats:
    light = np.asarray(photocurrent_a, np.float64)
    if light.ndim != 3 or not np.all((light >= 0) & (light < np.inf)):
        raise ValueError(
            f"photocurrent_a: shape {light.shape}; give (frames, rows, columns) of finite currents "
            "that are not negative (A)"
        )
    return light
