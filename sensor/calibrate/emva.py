"""Figures of EMVA 1288, release 4 (Linear), from means and variances at steps of light.

With µ_p photons on a pixel in an exposure, µ_y the mean and σ_y² the temporal variance of readings
(DN), averaged over pixels, and s_y² the variance over pixels of mean readings, less what σ_y² adds:

    R, K      slopes of µ_y over µ_p, and of σ_y² over µ_y, both less their dark values, from 0 to
              70 % of saturation
    η = R/K   quantum efficiency; one event is one electron
    σ_d       √(σ²_y.dark − σ²_q)/K, temporal dark noise before rounding, with σ²_y.dark of 0.24 DN²
              or more: rounding hides what is less
    µ_p.min   (σ_y.dark/K + ½)/η, absolute sensitivity threshold: about where the SNR is 1
    µ_p.sat   light at which σ_y² is largest; µ_e.sat = η·µ_p.sat, SNR_max = √µ_e.sat
    DR        µ_p.sat/µ_p.min
    DSNU      s_y.dark/K
    PRNU      standard deviation over pixels of y_50 − y_dark over its mean, at half of saturation
    LE        mean of |deviation from a line| over the line, from 5 to 95 % of saturation
    µ_I       slope of µ_y.dark over the exposure, over K: dark current

Rounding adds σ_q² = 1/12 DN² to readings of an ADC, and nothing to counts. The standard has s²_y.50
− s²_y.dark in place of the variance of differences; the two differ where hot pixels saturate.
Pixels whose dark signal exceeds a tenth of saturation are not part of PRNU. With dead time K is too
small in bright light, and η too large (`without_dead_time`).

With **electron multiplication** the slope of σ_y² over µ_y is K·F², with the excess noise factor
F², which the standard does not know. Here F² is taken out of K, η, σ_d and µ_e.sat, and is part of
µ_p.min = (σ_y.dark/K + F²/2)/η and SNR_max = √(µ_e.sat/F²).

Source: EMVA Standard 1288, Release 4.0 Linear (2021).
"""

import math
from collections.abc import Sequence
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import fminbound

from megalopta.core.arrays import Floats, mean_and_variance
from megalopta.core.quantities import number
from megalopta.sensor.change import changed
from megalopta.sensor.expectations import reading_moments
from megalopta.sensor.frame import moments as frame
from megalopta.sensor.frame.model import FrameSensor
from megalopta.sensor.spad.device import draw_fixed_pattern
from megalopta.sensor.spad.model import Sensor, without

FEWEST_STEPS = 8
"""Levels of light that are needed, without the dark."""
_STEP, _MOST_ARRIVALS = 1.2, 1e9
"""Growth of light when saturation is sought, and its limit in detections per exposure."""
_SIDE, _FEW = 64, 16
"""Largest sides (pixels) of the part of a device, its middle, for which moments are computed, and
with which saturation is sought."""


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


class Nonuniformity(NamedTuple):
    """Standard deviation of mean readings over pixels; total² = row² + column² + pixel²."""

    total: float
    row: float
    column: float
    pixel: float

    @classmethod
    def of(cls, means: Floats, noise: float, unit: float) -> "Nonuniformity":
        """Split that of mean readings (rows, columns), NaN where not known, in units.

        `noise`: temporal variance of a mean. Means over M rows or N columns retain 1/M or 1/N of
        the variance of pixels, which is subtracted (release 4.0 Linear, equations 41 to 44). NaN of
        fewer than three rows or columns.
        """
        m, n = means.shape
        total = float(np.nanvar(means)) - noise
        of_rows = float(np.nanvar(np.nanmean(means, axis=1))) - noise / n
        of_columns = float(np.nanvar(np.nanmean(means, axis=0))) - noise / m
        freedom = m * n - m - n if min(m, n) > 2 else np.nan
        row = ((m * n - n) * of_rows - m * (total - of_columns)) / freedom
        column = ((m * n - m) * of_columns - n * (total - of_rows)) / freedom
        pixel = m * n * (total - of_rows - of_columns) / freedom
        parts = np.array((total, row, column, pixel))
        parts[parts < 1e-24 * np.nanmean(means**2)] = 0  # rounding, or noise alone
        return cls(*(np.sqrt(parts) / unit).tolist())


class Emva(NamedTuple):
    """Figures of a camera; `FIGURES` has their symbols, meanings and units, with shares in %."""

    efficiency: float
    responsivity: float
    gain: float
    excess_noise: float
    dark_noise: float
    dsnu: Nonuniformity
    prnu: Nonuniformity
    linearity_error: float
    threshold_photons: float
    saturation_photons: float
    saturation_electrons: float
    snr_db: float
    dynamic_range_db: float
    dark_current: float = np.nan
    """NaN: not known"""


FIGURES = (
    ("η", "quantum efficiency (%)", "efficiency", 100),
    ("R", "responsivity (DN per photon)", "responsivity", 1),
    ("K", "system gain (DN per electron)", "gain", 1),
    ("F²", "excess noise factor; photon transfer gives K·F²", "excess_noise", 1),
    ("σ_d", "temporal dark noise (electrons)", "dark_noise", 1),
    ("µ_I", "dark current (electrons per second)", "dark_current", 1),
    ("DSNU₁₂₈₈", "dark signal nonuniformity (electrons)", "dsnu.total", 1),
    ("DSNU.row", "of rows (electrons)", "dsnu.row", 1),
    ("DSNU.col", "of columns (electrons)", "dsnu.column", 1),
    ("DSNU.pixel", "of pixels (electrons)", "dsnu.pixel", 1),
    ("PRNU₁₂₈₈", "photoresponse nonuniformity (%)", "prnu.total", 100),
    ("PRNU.row", "of rows (%)", "prnu.row", 100),
    ("PRNU.col", "of columns (%)", "prnu.column", 100),
    ("PRNU.pixel", "of pixels (%)", "prnu.pixel", 100),
    ("LE", "linearity error (%)", "linearity_error", 100),
    ("µ_p.min", "absolute sensitivity threshold (photons)", "threshold_photons", 1),
    ("µ_p.sat", "saturation (photons)", "saturation_photons", 1),
    ("µ_e.sat", "saturation capacity (electrons)", "saturation_electrons", 1),
    ("SNR_max", "largest signal-to-noise ratio (dB)", "snr_db", 1),
    ("DR", "dynamic range (dB)", "dynamic_range_db", 1),
)
"""Symbol, quantity, its name in `Emva`, and factor to its unit"""


def rows(*figures: Emva) -> tuple[tuple[str, ...], ...]:
    """Return rows of a table: symbol, quantity and its value for every camera."""
    return tuple(
        (symbol, title, *(number(scale * attrgetter(name)(camera)) for camera in figures))
        for symbol, title, name, scale in FIGURES
    )


def emva(
    dark: Step, steps: Sequence[Step], *, factors: tuple[float, float] = (1.0, 1.0),
    rounding: float = 0.0, excess_noise: float = 1.0,
) -> Emva:  # fmt: skip
    """Return the figures of a camera from a dark step and steps of increasing light.

    `factors` multiply R and K (`without_dead_time`). `rounding`: variance that rounding adds, DN²,
    1/12 of an ADC. `excess_noise`: F² of an electron-multiplying register, by which K is divided.

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
    responsivity = factors[0] * float(x @ y / (x @ x))
    gain = factors[1] * float(y @ z / (y @ y)) / excess_noise
    half = min(steps, key=lambda step: abs(step.level - dark.level - 0.5 * level[last]))
    # PRNU, of pixels that are not hot
    ordinary = dark.mean < np.nanmedian(dark.mean) + 0.1 * level[last]
    more = np.where(ordinary, half.mean - dark.mean, np.nan)
    mean_noise = np.nanmean((half.variance / half.frames + dark.variance / dark.frames)[ordinary])
    # linearity, by a line that minimizes squares of relative deviations, as the standard does
    low, high = (share * photons[last] for share in (0.05, 0.95))
    within = (low <= photons) & (photons <= high)
    x = photons[within]
    design = np.column_stack((np.ones_like(x), x)) / level[within, None]
    line = np.linalg.lstsq(design, np.ones_like(x), rcond=None)[0]
    dark_noise = float(np.sqrt(max(dark.noise, 0.24) - rounding)) / gain
    efficiency, saturation = responsivity / gain, float(photons[last])
    threshold = (math.hypot(dark_noise, math.sqrt(rounding) / gain) + excess_noise / 2) / efficiency
    return Emva(
        efficiency=efficiency, responsivity=responsivity, gain=gain, excess_noise=excess_noise,
        dark_noise=dark_noise, dsnu=Nonuniformity.of(dark.mean, dark.noise / dark.frames, gain),
        prnu=Nonuniformity.of(more, float(mean_noise), float(np.nanmean(more))),
        linearity_error=float(np.mean(np.abs(level[within] / (line[0] + line[1] * x) - 1))),
        threshold_photons=threshold, saturation_photons=saturation,
        saturation_electrons=efficiency * saturation,
        snr_db=10 * math.log10(efficiency * saturation / excess_noise),
        dynamic_range_db=20 * math.log10(saturation / threshold),
    )  # fmt: skip


def device_emva(sensor: Sensor | FrameSensor, shape: tuple[int, int], wavelength_nm: float) -> Emva:
    """Return the exact figures of a device, without dead time; as `device_steps`."""
    at = shape, wavelength_nm
    dark, steps = device_steps(sensor, *at)
    if isinstance(sensor, FrameSensor):
        figures = emva(dark, steps, rounding=1 / 12, excess_noise=sensor.em.excess_noise)
    else:
        figures = emva(dark, steps, factors=without_dead_time(sensor, *at, steps))
    longer = changed(sensor, exposure_s=2 * sensor.exposure_s)
    (darker,) = _exact_steps(longer, *at, [0.0])
    dark_current = (darker.level - dark.level) / figures.gain / sensor.exposure_s
    return figures._replace(dark_current=dark_current)


def device_steps(
    sensor: Sensor | FrameSensor, shape: tuple[int, int], wavelength_nm: float
) -> tuple[Step, list[Step]]:
    """Return the exact dark step of a device, and 50 steps up to saturation.

    At its exposure, of the middle 64 × 64 pixels of (rows, columns) at most; counts, or DN of a
    frame camera.

    Raises ValueError if its readings do not saturate at any light that can be computed.
    """
    few = min(shape[0], _FEW), min(shape[1], _FEW)

    def noise(photons: float) -> float:
        return _exact_steps(sensor, few, wavelength_nm, [photons])[0].noise

    efficiency = float(sensor.photon_detection_efficiency(np.array(wavelength_nm)))
    end, peak, scan = 0.0, 0.0, 1.0
    while scan * efficiency < _MOST_ARRIVALS:
        if (at_scan := noise(scan)) > peak:
            end, peak = scan, at_scan
        elif at_scan < 0.5 * peak or scan > 4 * end:  # a register's noise stays
            break
        scan *= _STEP
    else:
        raise ValueError("readings do not saturate; give the counter a capacity")
    end = float(fminbound(lambda x: -noise(x), end / _STEP, end * _STEP, xtol=1e-4 * end))
    dark, *steps = _exact_steps(sensor, shape, wavelength_nm, np.linspace(0, end, 51))
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
    at = shape, wavelength_nm
    dark, *lit = _exact_steps(sensor, *at, [0.0, *(step.photons for step in steps)])
    dead = emva(dark, lit)
    # light at which no counter is near its end
    dim = [0.0, 0.01 * dead.saturation_photons]
    low, high = _exact_steps(without(sensor, "dead_time"), *at, dim)
    rise = high.level - low.level
    return rise / dim[1] / dead.responsivity, (high.noise - low.noise) / rise / dead.gain


def _exact_steps(
    sensor: Sensor | FrameSensor,
    shape: tuple[int, int],
    wavelength_nm: float,
    photons: Sequence[float] | Floats,
) -> list[Step]:
    """Steps of the middle of a device."""
    side = min(shape[0], _SIDE), min(shape[1], _SIDE)
    light = np.asarray(photons, np.float64)
    efficiency = sensor.photon_detection_efficiency(np.array(wavelength_nm))
    rates_hz = (light / sensor.exposure_s * efficiency)[:, None, None] * np.ones(side)
    if isinstance(sensor, FrameSensor):  # its model has the pixels' response; lag changes no mean
        dn_per_e = sensor.em.gain / sensor.adc.e_per_dn
        mean_e, variance_e2 = frame.reading_moments(rates_hz, changed(sensor, lag_share=0.0))
        return list(map(Step, light.tolist(), dn_per_e * mean_e, dn_per_e**2 * variance_e2))
    if sensor.measured.is_on:
        sensor = changed(sensor, measured={"fit": "center"})
    rates_hz *= draw_fixed_pattern(sensor, side).efficiency_factor
    return list(map(Step, light.tolist(), *reading_moments(rates_hz, sensor)))
