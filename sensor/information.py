"""Fisher information of a reading about the light: how well one frame tells a mean number.

Of a reading r whose probability p(r | µ) depends on the mean number µ of photoelectrons that light
frees in an exposure, J(µ) = Σ_r (∂p/∂µ)²/p, in electrons⁻²; 1/µ for a detector without noise.

**Frame cameras**: electrons of light and dark have the Poisson probabilities P_n, cut at the full
well, and ∂P_n/∂µ = P_(n−1) − P_n. Where one leaves the register as electrons of the characteristic
function φ, and noise has χ, readings have χ·ΣP_n·φⁿ. In each stage φ becomes φ·(1 − q + q·φ), with
q as in `EmRegister.chance`. A Fourier transform gives densities, which the ADC's codes sum. J is a
mean over the read noise and dark current of pixels; offsets count as known, noise of rows and
columns as that of pixels, image lag as absent. This is tabulated to 100 electrons; above, readings
are normal, censored where well or ADC are full. Within 1 %; where a well is half full, it is too
large by 0.8 of read noise over shot noise, 5 % for 2 in 1000 electrons.

**SPAD and CTIA arrays**: (∂m/∂µ)²/v of readings' mean m and variance v, at each pixel: exact for
Poisson counts and single bits, and never too large (Cauchy and Schwarz); 5 % too small of an analog
counter with noise of 1.5 steps in the dark. For digital counters that do not wrap times what the
distribution of a nominal pixel's counts tells beyond its mean, up to 10⁴ arrivals. If an avalanche
fires p neighbors, v is 1/(1 − p)² times as large, as for sums over many pixels (Borel).
"""

import math
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.fft import next_fast_len
from scipy.interpolate import PchipInterpolator
from scipy.special import gammaln, ndtr, xlogy

from megalopta.core.arrays import Floats
from megalopta.sensor.contrast.model import ContrastSensor
from megalopta.sensor.effects.crosstalk import Crosstalk
from megalopta.sensor.expectations import moments
from megalopta.sensor.frame.model import Adc, EmRegister, FrameSensor, ReadNoise
from megalopta.sensor.image_sensors import ImageSensor, sensor_named
from megalopta.sensor.spad.counters import DigitalCounter
from megalopta.sensor.spad.device import draw_fixed_pattern
from megalopta.sensor.spad.distributions import event_distribution
from megalopta.sensor.spad.model import AvalancheEffects, Sensor
from megalopta.sensor.spad.moments import count_moments

_DEVICE = 32, 32
"""Pixels that stand for a device where no image says which"""
_MANY_E = 100.0
"""Electrons above which readings of frame cameras are normal"""
_LIGHTS = np.concatenate((np.geomspace(1e-6, 1, 37), np.arange(1.5, 100.5, 0.5) ** 2))
"""Mean numbers for which information is tabulated: a standard deviation apart above 1"""
_STEP = 0.02
"""Change of light that gives slopes, in standard deviations of its number"""
_CONSTANT, _ROUNDING = 1e-10, 1e-13
"""Variance over squared mean below which a reading is constant; probability that is rounding"""


def information(electrons: ArrayLike, sensor: ImageSensor | str | Path) -> Floats:
    """Return the Fisher information of a reading on the mean number of photoelectrons of light.

    Of one exposure, electrons⁻², in the shape of `electrons`, (..., H, W), (n,) or a number: mean
    photoelectrons of light in an exposure of a nominal pixel (`detected_rate` times exposure). In
    an image they meet the pixels of a SPAD or CTIA device at their places; for fewer axes, and
    frame cameras, the information is the mean over pixels. That of n exposures adds up.
    """
    light, sensor = np.asarray(electrons, np.float64), sensor_named(sensor)
    if isinstance(sensor, ContrastSensor):
        raise ValueError(
            f"sensor {sensor.name!r}: events of contrast tell of changes, not of light"
        )
    if isinstance(sensor, FrameSensor):
        return _frame_information(light, sensor)
    if light.ndim < 2:
        images = np.broadcast_to(light.reshape(-1, 1, 1), (light.size, *_DEVICE))
        return np.asarray(information(images, sensor).mean(axis=(1, 2)).reshape(light.shape))
    frames = light.reshape(-1, *light.shape[-2:])
    step = _STEP / np.sqrt(1 + frames)
    lights = np.stack((frames * (1 - step), frames * (1 + step)))
    means, variances = _moments(lights.reshape(-1, *light.shape[-2:]), sensor)
    (below, above), variance = means.reshape(lights.shape), variances.reshape(lights.shape).mean(0)
    fisher = np.zeros_like(frames)
    varies = (variance > _CONSTANT * above**2) & (frames > 0)
    np.divide((above - below) ** 2, (lights[1] - lights[0]) ** 2 * variance, fisher, where=varies)
    if isinstance(sensor, Sensor):
        fisher *= (1 - sensor.crosstalk.mean_fired_neighbors) ** 2 * _beyond_mean(frames, sensor)
    return fisher.reshape(light.shape)


def reading_noise(sensor: ImageSensor) -> tuple[float, float]:
    """Return a and b of the variance a·mean + b of readings, means over pixels.

    From the moments in the dark and at one electron; 1 and 0 for SPAD arrays, as without dead time,
    and for contrast.
    """
    if isinstance(sensor, Sensor | ContrastSensor):
        return 1.0, 0.0
    lights = np.broadcast_to(np.array([[[0.0]], [[1.0]]]), (2, *_DEVICE))
    mean, variance = (part.mean(axis=(1, 2)) for part in _moments(lights, sensor))
    slope = float((variance[1] - variance[0]) / (mean[1] - mean[0]))
    return slope, max(0.0, float(variance[0] - slope * mean[0]))


def _moments(electrons: Floats, sensor: ImageSensor) -> tuple[Floats, Floats]:
    """Mean and variance of readings (T, H, W)."""
    rate_hz = electrons / sensor.exposure_s
    if isinstance(sensor, Sensor):
        device = draw_fixed_pattern(sensor, (electrons.shape[1], electrons.shape[2]))
        rate_hz *= device.efficiency_factor
    _, _, mean, variance = moments(rate_hz, sensor)
    return mean, variance


def _tabulated(light: Floats, at_light: Callable[[int], float]) -> Floats:
    """Return values at lights of any shape, from those at `_LIGHTS` around them, by number."""
    inside = light.clip(_LIGHTS[0], _LIGHTS[-1])
    first, last = np.searchsorted(_LIGHTS, (inside.min(), inside.max()))
    numbers = np.arange(max(first - 2, 0), min(last + 3, len(_LIGHTS)))
    values = [at_light(int(number)) for number in numbers]
    return np.asarray(PchipInterpolator(np.log(_LIGHTS[numbers]), values)(np.log(inside)))


# Frame cameras


def _frame_information(light: Floats, sensor: FrameSensor) -> Floats:
    chain = sensor.full_well_e, sensor.em, sensor.read, sensor.adc
    spread = sensor.dark.log_sigma
    median_e = sensor.dark.now_e_s * sensor.exposure_s * math.exp(-(spread**2) / 2)
    fisher = np.zeros_like(light)
    for share, factor in _log_normal(spread):
        total = light + sensor.cic_e + median_e * factor
        few = total.clip(_LIGHTS[0], _MANY_E)
        few_told = _tabulated(few, lambda number: _few_electrons(number, *chain)) / few
        fisher += share * np.where(total < _MANY_E, few_told, _many_electrons(total, *chain))
    return fisher


def _log_normal(log_sigma: float) -> list[tuple[float, float]]:
    """Shares and factors of pixels that stand for a log-normal spread about the median."""
    quantiles, weights = np.polynomial.hermite_e.hermegauss(7 if log_sigma > 0 else 1)
    return list(zip(weights / weights.sum(), np.exp(log_sigma * quantiles), strict=True))


def _amplifiers(read: ReadNoise) -> list[tuple[float, float, float]]:
    """Share of pixels, standard deviation and distance of two levels (electrons) of each kind."""
    steady, kinds = 1 - read.telegraph_share, []
    for share, factor in _log_normal(read.log_sigma):
        noise_e = math.hypot(read.median_e * factor, read.row_e, read.column_e)
        kinds += [(share * steady, noise_e, 0.0), (share * (1 - steady), noise_e, read.telegraph_e)]
    return kinds


@lru_cache(maxsize=4096)
def _few_electrons(
    number: int, full_well_e: float, em: EmRegister, read: ReadNoise, adc: Adc
) -> float:
    """Information on a mean of `_LIGHTS[number]` electrons, times that mean."""
    mean = float(_LIGHTS[number])
    n = np.arange(min(int(full_well_e), math.ceil(mean + 8 * math.sqrt(mean) + 12)) + 1)
    chance = np.exp(xlogy(n, mean) - mean - gammaln(n + 1))
    slope = -np.diff(chance, prepend=0.0)
    chance[-1], slope[-1] = 1 - chance[:-1].sum(), -slope[:-1].sum()  # the well holds no more

    kinds = [(share, max(e, em.gain / 100), levels_e) for share, e, levels_e in _amplifiers(read)]
    least_e = min(noise_e for _, noise_e, _ in kinds)
    most_e = max(8 * noise_e + levels_e for _, noise_e, levels_e in kinds)
    # an odd number of points for a code of the ADC
    step_e = adc.e_per_dn / (2 * math.ceil(0.75 * adc.e_per_dn / least_e - 0.5) + 1)
    tail_e = 25 * em.gain if em.gain > 1 else 0.0
    below = math.ceil(most_e / step_e)
    points = next_fast_len(2 * below + math.ceil((em.gain * n[-1] + tail_e) / step_e) + 2)
    angular = 2 * np.pi * np.fft.rfftfreq(points, step_e)
    gain = np.exp(-1j * angular)
    for _ in range(em.stages if em.gain > 1 else 0):
        gain *= 1 - em.chance + em.chance * gain
    spectra = np.zeros((2, angular.size), complex)
    for weights in np.stack((chance, slope), axis=-1)[::-1]:
        spectra = spectra * gain + weights[:, np.newaxis]
    spectra *= np.sinc(angular * step_e / (2 * np.pi))  # sums over a step

    places = np.arange(points)
    places[points - below :] -= points
    output_dn = np.minimum(places * step_e, em.well_e) / adc.e_per_dn
    codes = np.rint(output_dn + adc.black_dn).clip(0, adc.largest_dn).astype(np.int64)
    codes -= codes.min()
    fisher = 0.0
    for share, noise_e, levels_e in kinds:
        noise = np.exp(-((noise_e * angular) ** 2) / 2) * np.cos(levels_e / 2 * angular)
        densities = np.fft.irfft(spectra * noise, points)
        fisher += share * _of_probabilities(*(np.bincount(codes, density) for density in densities))
    return fisher * mean


def _of_probabilities(p: NDArray[Any], slope: NDArray[Any]) -> float:
    seen = p > _ROUNDING
    return float(np.sum(slope[seen] ** 2 / p[seen]))


def _many_electrons(
    mean: Floats, full_well_e: float, em: EmRegister, read: ReadNoise, adc: Adc
) -> Floats:
    """Information on means of electrons, of normal readings that are censored at the top."""
    of_adc_e = (adc.largest_dn - adc.black_dn) * adc.e_per_dn
    most_e = min(int(full_well_e) - 0.5, em.well_e / em.gain, of_adc_e / em.gain)
    fisher = np.zeros_like(mean)
    for share, noise_e, levels_e in _amplifiers(read):
        added_e2 = (noise_e**2 + levels_e**2 / 4 + adc.e_per_dn**2 / 12) / em.gain**2
        variance = em.excess_noise * mean + added_e2
        z = (most_e - mean) / np.sqrt(variance)
        density, full = np.exp(-(z**2) / 2) / math.sqrt(2 * math.pi), ndtr(-z)
        censored = ndtr(z) - z * density + density**2 / np.maximum(full, 1e-300)
        fisher += share * np.maximum(censored, 0) / variance
    return fisher


# SPAD arrays


def _beyond_mean(light: Floats, sensor: Sensor) -> Floats | float:
    """Information of nominal readings over that in their mean, 1 or more, for light (T, H, W)."""
    counter = sensor.counter
    is_plain = not (counter.is_on or sensor.dead_time.is_on) or counter.sums > 1
    if is_plain or not isinstance(counter, DigitalCounter) or counter.overflow == "wrap":
        return 1.0
    dark_hz = draw_fixed_pattern(sensor, (light.shape[1], light.shape[2])).dark_counts_hz
    effects = sensor.avalanche_effects.replaced(crosstalk=Crosstalk())
    nominal = effects, counter.capacity, sensor.exposure_s
    arrivals = light + np.median(dark_hz) * sensor.exposure_s
    return _tabulated(arrivals, lambda number: _nominal_beyond_mean(number, *nominal))


@lru_cache(maxsize=4096)
def _nominal_beyond_mean(
    number: int, effects: AvalancheEffects, capacity: int, exposure_s: float
) -> float:
    arrivals = float(_LIGHTS[number])
    lights = arrivals * (1 + _STEP / math.sqrt(1 + arrivals) * np.array([-1.0, 0.0, 1.0]))
    mean, variance = count_moments(lights / exposure_s, exposure_s, effects)
    variance = np.maximum(variance, 0.0)  # of a count at its ceiling
    first, chances = event_distribution(lights, mean, variance, exposure_s, effects)
    events = first[:, np.newaxis] + np.arange(chances.shape[1])
    counts = np.minimum(events - first.min(), max(capacity - first.min(), 0)).astype(np.int64)
    rows = zip(counts, chances, strict=True)
    below, p, above = (np.bincount(n, chance, counts.max() + 1) for n, chance in rows)
    slope, reading = above - below, np.arange(p.size)
    in_mean = (reading @ slope) ** 2 / max((reading - reading @ p) ** 2 @ p, 1e-300)
    return max(1.0, _of_probabilities(p, slope) / in_mean) if in_mean > 1e-12 else 1.0
