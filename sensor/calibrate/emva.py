"""Figures of EMVA 1288, release 4 (Linear), from means and variances at steps of light.

With µ_p photons on a pixel in an exposure, µ_y the mean and σ_y² the temporal variance of readings
(DN), averaged over pixels, and s_y² the variance over pixels of mean readings, less what σ_y² adds:

    R, K      slopes of µ_y over µ_p, and of σ_y² over µ_y, both less their dark values, from 0 to
              70 % of saturation
    η = R/K   quantum efficiency; one event is one electron
    σ_d       σ_y.dark/K, temporal dark noise, with σ²_y.dark of 0.24 DN² or more: rounding hides
              what is less
    µ_p.min   (σ_d + ½)/η, absolute sensitivity threshold: about where the SNR is 1
    µ_p.sat   light at which σ_y² is largest; µ_e.sat = η·µ_p.sat, SNR_max = √µ_e.sat
    DR        µ_p.sat/µ_p.min
    DSNU      s_y.dark/K
    PRNU      standard deviation over pixels of y_50 − y_dark over its mean, at half of saturation
    LE        mean of |deviation from a line| over the line, from 5 to 95 % of saturation

Rounding adds no noise, 1/12 DN² in the standard, to counts. The standard has s²_y.50 − s²_y.dark in
place of the variance of differences; the two differ where hot pixels saturate. Pixels whose dark
signal exceeds a tenth of saturation are not part of PRNU. With dead time K is too small in bright
light, and η too large (`without_dead_time`).

Source: EMVA Standard 1288, Release 4.0 Linear (2021).
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, mean_and_variance
from megalopta.sensor.change import changed
from megalopta.sensor.expectations import reading_moments
from megalopta.sensor.spad.device import draw_fixed_pattern
from megalopta.sensor.spad.model import Sensor, without

FEWEST_STEPS = 8
"""Levels of light that are needed, without the dark."""
_STEP, _MOST_ARRIVALS = 1.2, 1e9
"""Growth of light when saturation is sought, and its limit in detections per exposure."""
_SIDE = 64
"""Largest side (pixels) of the part of a device, its middle, for which moments are computed."""


class Step(NamedTuple):
    """Readings at one level of light."""

    photons: float
    """Photons per pixel and exposure; 0: dark"""
    mean: Floats
    """Mean reading of every pixel, (rows, columns)"""
    variance: Floats
    """Temporal variance, (rows, columns)"""
    frames: float = np.inf
    """Number of frames of which these are estimates; infinite: exact"""

    @classmethod
    def of(cls, photons: float, frames: NDArray[Any]) -> "Step":
        """Return the step of readings (n, rows, columns)."""
        return cls(photons, *mean_and_variance(frames), len(frames))

    @property
    def level(self) -> float:
        """Mean over time and pixels, µ_y."""
        return float(np.nanmean(self.mean))

    @property
    def noise(self) -> float:
        """Temporal variance σ_y²."""
        return float(np.nanmean(self.variance))

    @property
    def spread(self) -> float:
        """Variance over pixels s_y²."""
        return max(float(np.nanvar(self.mean)) - self.noise / self.frames, 0.0)


class Emva(NamedTuple):
    """Figures of a camera; electrons are events."""

    responsivity: float
    """R, DN per photon"""
    gain: float
    """K, DN per electron"""
    dark_noise: float
    """σ_d, electrons"""
    dsnu: float
    """DSNU1288, electrons"""
    prnu: float
    """PRNU1288, share"""
    linearity_error: float
    """LE, share"""
    saturation_photons: float
    """µ_p.sat"""

    @property
    def efficiency(self) -> float:
        """Quantum efficiency η."""
        return self.responsivity / self.gain

    @property
    def threshold_photons(self) -> float:
        """Absolute sensitivity threshold µ_p.min."""
        return float((self.dark_noise + 0.5) / self.efficiency)

    @property
    def saturation_electrons(self) -> float:
        """Saturation capacity µ_e.sat."""
        return self.efficiency * self.saturation_photons

    @property
    def snr_db(self) -> float:
        """Largest signal-to-noise ratio SNR_max, dB."""
        return float(10 * np.log10(self.saturation_electrons))

    @property
    def dynamic_range_db(self) -> float:
        """Dynamic range DR, dB."""
        return float(20 * np.log10(self.saturation_photons / self.threshold_photons))


def emva(dark: Step, steps: Sequence[Step], *, factors: tuple[float, float] = (1.0, 1.0)) -> Emva:
    """Return the figures of a camera from a dark step and steps of increasing light.

    `factors` multiply R and K (`without_dead_time`).

    Raises ValueError if there are too few steps, or the brightest is not above the dark.
    """
    steps = sorted(steps, key=lambda step: step.photons)
    if len(steps) < FEWEST_STEPS:
        raise ValueError(f"{len(steps)} levels of light; EMVA 1288 needs {FEWEST_STEPS}, better 50")
    photons, level, noise = np.array([(step.photons, step.level, step.noise) for step in steps]).T
    level, noise = level - dark.level, noise - dark.noise
    last = int(np.argmax(noise))
    if level[last] <= 0 or noise[last] <= 0:
        raise ValueError("the brightest light is no brighter than the dark; uncover the sensor")
    linear = (photons <= 0.7 * photons[last]) & (np.arange(len(steps)) <= last)
    if linear.sum() < 2:
        raise ValueError("saturated above the dimmest light; add dimmer levels")
    # slopes of lines through the origin
    x, y, z = photons[linear], level[linear], noise[linear]
    responsivity, gain = factors[0] * float(x @ y / (x @ x)), factors[1] * float(y @ z / (y @ y))
    half = min(steps, key=lambda step: abs(step.level - dark.level - 0.5 * level[last]))
    # PRNU, of pixels that are not hot
    ordinary = dark.mean < np.nanmedian(dark.mean) + 0.1 * level[last]
    more = (half.mean - dark.mean)[ordinary]
    mean_noise = np.nanmean((half.variance / half.frames + dark.variance / dark.frames)[ordinary])
    spread = max(float(np.nanvar(more)) - float(mean_noise), 0.0)
    prnu = float(np.sqrt(spread) / np.nanmean(more))
    # linearity, by a line that minimizes squares of relative deviations, as the standard does
    low, high = (share * photons[last] for share in (0.05, 0.95))
    within = (low <= photons) & (photons <= high)
    x = photons[within]
    design = np.column_stack((np.ones_like(x), x)) / level[within, None]
    line = np.linalg.lstsq(design, np.ones_like(x), rcond=None)[0]
    return Emva(
        responsivity=responsivity,
        gain=gain,
        dark_noise=float(np.sqrt(max(dark.noise, 0.24))) / gain,
        dsnu=float(np.sqrt(dark.spread)) / gain,
        prnu=prnu,
        linearity_error=float(np.mean(np.abs(level[within] / (line[0] + line[1] * x) - 1))),
        saturation_photons=float(photons[last]),
    )


def device_steps(
    sensor: Sensor, shape: tuple[int, int], wavelength_nm: float
) -> tuple[Step, list[Step]]:
    """Return the exact dark step of a device, and 50 steps up to saturation.

    At its exposure, of the middle 64 × 64 pixels of (rows, columns) at most.

    Raises ValueError if its readings do not saturate at any light that can be computed.
    """
    device, efficiency = _middle(sensor, shape, wavelength_nm)
    end, peak, scan = 0.0, 0.0, 1.0
    while scan * float(efficiency.max()) < _MOST_ARRIVALS:
        noise = _exact_steps(device, efficiency, [scan])[0].noise
        if noise > peak:
            end, peak = scan * _STEP, noise
        elif noise < 0.5 * peak:
            break
        scan *= _STEP
    else:
        raise ValueError("readings do not saturate; give the counter a capacity")
    dark, *steps = _exact_steps(device, efficiency, np.linspace(0, end, 51))
    return dark, steps


def without_dead_time(
    sensor: Sensor, shape: tuple[int, int], wavelength_nm: float, steps: Sequence[Step]
) -> tuple[float, float]:
    """Return the factors on R and K, from these steps of light, that take out dead time.

    They are ratios of exact moments of the device without and with its dead time, (1, 1) if it has
    none. Raises ValueError as `emva`.
    """
    if not sensor.dead_time.is_on:
        return 1.0, 1.0
    device, efficiency = _middle(sensor, shape, wavelength_nm)
    photons = [0.0, *(step.photons for step in steps)]
    dark, *lit = _exact_steps(device, efficiency, photons)
    dead = emva(dark, lit)
    # light at which no counter is near its end
    dim = [0.0, 0.01 * dead.saturation_photons]
    low, high = _exact_steps(without(device, "dead_time"), efficiency, dim)
    rise = high.level - low.level
    return rise / dim[1] / dead.responsivity, (high.noise - low.noise) / rise / dead.gain


def _middle(sensor: Sensor, shape: tuple[int, int], wavelength_nm: float) -> tuple[Sensor, Floats]:
    """Middle of a device, and the efficiency of its pixels."""
    if sensor.measured.is_on:
        sensor = changed(sensor, measured={"fit": "center"})
    side = min(shape[0], _SIDE), min(shape[1], _SIDE)
    efficiency = float(sensor.photon_detection_efficiency(np.array(wavelength_nm)))
    return sensor, efficiency * draw_fixed_pattern(sensor, side).efficiency_factor


def _exact_steps(
    device: Sensor, efficiency: Floats, photons: Sequence[float] | Floats
) -> list[Step]:
    light = np.asarray(photons, np.float64)
    rates_hz = light[:, None, None] / device.exposure_s * efficiency
    return list(map(Step, light.tolist(), *reading_moments(rates_hz, device)))
