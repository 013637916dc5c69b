"""A device from its recordings: all estimators in sequence."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.stats import chi2

from megalopta.core.arrays import Floats, Mask
from megalopta.sensor.calibrate.comb import HIDDEN_AT, Curve, comb_period, fit_comb
from megalopta.sensor.calibrate.crosstalk import Kernel, mean_kernel, neighbor_kernel
from megalopta.sensor.calibrate.level import (
    Adc,
    Falls,
    Level,
    check_levels,
    falls_of,
    photon_transfer,
)
from megalopta.sensor.calibrate.pixels import hot_pixels
from megalopta.sensor.calibrate.saturation import MeanCounts, fit_saturation, misfit

_95 = 1.959964
_WIDEST_SEARCH, _NARROWEST_SEARCH = 0.25, 0.15
_DEVIATIONS_SEARCHED = 5.0
_SHALLOW = 0.12
"""Fraction of the swing above which a changing step blurs the comb."""
_LOUDEST = 2.0
"""Residual, relative to the comb's median, above which a pixel's fit has failed."""
_SURELY = 5.0
_FAR_LEAK = 40.0
"""Distance from the median, relative to its median, above which a leak is implausible."""
_SURE_OFFSET = 0.2
"""Standard error of the offset, in steps, above which peaks cannot be distinguished."""
_CLEAR_KIND = 6.0
"""Log-likelihood ratio above which the kind of dead time is named."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """One quantity of every pixel with its 95 % CI, each (rows, columns); NaN: unknown."""

    value: Floats
    low: Floats
    high: Floats

    @classmethod
    def normal(cls, value: Floats, error: Floats, shape: tuple[int, int]) -> "Estimate":
        """Return a value with the interval of this standard error."""
        error = np.where(error > 0, error, np.nan)
        value, spread = np.where(np.isfinite(error), value, np.nan), _95 * error
        return cls(*(each.reshape(shape) for each in (value, value - spread, value + spread)))

    @property
    def median(self) -> float:
        """Median over the known pixels; NaN if none is known."""
        return float(np.nanmedian(self.value)) if np.isfinite(self.value).any() else np.nan

    def where(self, known: Mask, value: float = np.nan) -> "Estimate":
        """Return the estimate with another value, and interval, where it is not known."""
        ends = self.value, self.low, self.high
        return Estimate(*(np.where(known, each, value) for each in ends))

    def scaled(self, factor: Floats | float) -> "Estimate":
        """Return the estimate in another unit."""
        return Estimate(self.value * factor, self.low * factor, self.high * factor)


@dataclass(frozen=True, eq=False, kw_only=True)
class Device:
    """Estimates of a device, and the data behind them."""

    offset_v: Estimate
    """Drop of the output below the top of the ADC without events or leak: positive lowers it, as
    events do. `AnalogPixels.offset_v` and the map `offset` of a device file, which add to the
    output, have the opposite sign."""
    leak_v_s: Estimate
    step_v: Estimate
    read_noise_v: Estimate
    dark_counts_hz: Estimate
    efficiency: Estimate | None
    """Events per unit of light; None without flat frames"""
    dead_time_s: Estimate | None
    dead_time_kind: str | None
    """None if the saturation curve does not determine it"""
    kind_ratio: float
    """Log-likelihood ratio of the two kinds"""
    misfit: float = 0.0
    """Deviation of counts from the saturation curve, relative, if it does not hold: neither
    efficiency nor dead time is stated"""
    kernel: Kernel | None = None
    """Crosstalk kernel; None if too few pixels have neighbors"""
    hot: Mask
    """(rows, columns)"""
    counts: MeanCounts
    """Mean counts behind the saturation curve"""
    falls: Falls
    curve: Curve
    """Change of the step over the swing"""
    slope_error: float
    """Standard error of its slope; infinite if it is not determined"""

    @property
    def is_slope_seen(self) -> bool:
        """True if the step changes over the swing, beyond 3 standard errors."""
        return abs(self.curve.slope) > 3 * self.slope_error

    def counts_of(self, level: Level, adc: Adc) -> Floats:
        """Counts, not rounded, from the ADC codes of frames (n, rows, columns)."""
        leak = np.nan_to_num(self.leak_v_s.value) * level.exposure_s
        fall = (adc.top - level.readings) * adc.lsb_v
        steps = (fall - self.offset_v.value - leak) / self.step_v.value
        return self.curve.numbers(steps, self.step_v.value)


def calibrate_device(levels: Sequence[Level], adc: Adc, *, hot_times: float = 10.0) -> Device:
    """Estimate all parameters that dark and lit levels determine, with 95 % CI.

    Parameters
    ----------
    levels : sequence of Level
        Dark frames at three or more exposures; flat frames at two or more light levels, or none.
    hot_times : float
        Pixels significantly above this many times the median dark counts are hot.

    Raises ValueError if the recordings are insufficient (`check_levels`), or the shortest dark
    exposure is too long to determine the level of no counts.
    """
    check_levels(levels, adc)
    falls = falls_of(levels, adc)
    transfer = photon_transfer(falls)
    steps = transfer.step_v
    typical = float(np.median(steps))
    low, high = np.percentile(steps, (16, 84)) / typical
    error = float(np.median(transfer.step_error_v)) / typical
    scatter = np.sqrt(max(((high - low) / 2) ** 2 - error**2, 0.0))
    within = _DEVIATIONS_SEARCHED * max(scatter, error / np.sqrt(steps.size))
    within = float(np.clip(within, _NARROWEST_SEARCH, _WIDEST_SEARCH))
    is_shallow = falls.mean_v[falls.level, falls.pixel] < _SHALLOW * adc.swing_v
    step, noise = comb_period(falls.at(is_shallow), np.full(steps.size, typical), within)
    # outputs that the ADC cuts off look like a peak; the variance reveals them
    louder = np.maximum(noise, np.sqrt(transfer.read_variance_v2) / transfer.step_v)
    if np.median(louder) > HIDDEN_AT:
        raise ValueError(
            f"read noise of {np.median(louder):.2g} steps hides single events; lower it to "
            f"{HIDDEN_AT:g} or less, or calibrate from counts"
        )
    if np.median(transfer.offset_error_v / step) > _SURE_OFFSET:
        raise ValueError(
            "dark frames: the shortest exposure is too long to find the reading of no counts; add "
            "shorter ones, with few or no counts per frame"
        )
    fit = fit_comb(falls, step, transfer.offset_v, adc.swing_v)
    if np.median(fit.noise_v / fit.solution[:, 2]) > _LOUDEST * np.median(louder):
        raise ValueError(
            "the peaks of the comb cannot be followed through the swing, as if the step changed by "
            "more than a tenth over it; omit the levels with most counts"
        )
    rows, columns = levels[0].readings.shape[1:]
    shape = rows, columns
    errors = _standard_errors(fit.covariance)
    # pixels whose peaks were misassigned: too noisy, or with an implausible leak
    failed = ~(fit.noise_v <= _LOUDEST * np.median(fit.noise_v))
    leak_v_s = fit.solution[:, 1]
    failed |= leak_v_s < -_SURELY * errors[:, 1]
    # peaks that are off by whole counts at the longest exposure look like leak
    apart = np.abs(leak_v_s - np.median(leak_v_s))
    failed |= apart > _FAR_LEAK * np.median(apart)
    failed |= falls.frames.sum(axis=0) == 0
    errors[failed], falls.frames[:, failed] = np.nan, 0
    offset, leak, step_v = _estimates(fit.solution, errors, shape)
    mean = fit.counts / np.maximum(falls.frames, 1)
    counts = MeanCounts(mean, falls.frames, falls.exposure_s, falls.light_hz)
    read = np.sqrt(np.maximum(fit.noise_v**2 - adc.lsb_v**2 / 12, 0))
    read_error = fit.noise_v**2 / np.sqrt(2 * np.maximum(fit.readings, 1)) / np.maximum(read, 1e-12)
    saturation = _saturation(counts, shape)
    is_dark = counts.light_hz == 0
    live = (counts.frames * counts.exposure_s[:, None])[is_dark].sum(axis=0)
    total = fit.counts[is_dark].sum(axis=0)
    rates = np.stack([total, *garwood_interval(total)]) / np.where(live > 0, live, np.nan)
    dark = Estimate(*rates.reshape(3, *shape))
    if saturation["dead_time_kind"]:
        # to first order, both kinds of dead time hide the same counts
        dark = dark.scaled(1 + dark.value * float(np.nanmedian(saturation["dead_time_s"].value)))
    device = Device(
        offset_v=offset,
        leak_v_s=leak,
        step_v=step_v,
        read_noise_v=Estimate.normal(read, read_error, shape),
        dark_counts_hz=dark,
        hot=hot_pixels(dark.low, dark.value, dark.high, hot_times),
        counts=counts,
        falls=falls,
        curve=fit.curve,
        slope_error=fit.slope_error,
        **saturation,
    )
    kernels = []
    for level, frames in zip(levels, counts.frames, strict=True):
        if level.is_dark:
            # pixels with a failed fit have no counts
            seen = np.nan_to_num(np.rint(device.counts_of(level, adc)))
            good = (frames.reshape(shape) > 0) & (seen.mean(axis=0) > 0)
            with suppress(ValueError):  # too few pixels remain at this exposure
                kernels.append(neighbor_kernel(seen, good))
    if not kernels:
        return device
    kernel = mean_kernel(kernels)
    # readings that noise moves to the next peak vary as afterpulses do
    return replace(device, kernel=kernel if fit.is_clear else kernel.without_afterpulses)


def _estimates(solution: Floats, errors: Floats, shape: tuple[int, int]) -> list[Estimate]:
    """Estimates of the columns of a solution (P, k)."""
    return [Estimate.normal(*each, shape) for each in zip(solution.T, errors.T, strict=True)]


def _standard_errors(covariance: Floats) -> Floats:
    return np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0))


def garwood_interval(counts: Floats) -> tuple[Floats, Floats]:
    """Return the Poisson means between which counts, of any shape, lie with at least 95 %.

    F. Garwood, Biometrika 28, 437 (1936).
    """
    low = np.where(counts > 0, chi2.ppf(0.025, 2 * np.maximum(counts, 1e-9)) / 2, 0.0)
    return low, np.asarray(chi2.isf(0.025, 2 * (counts + 1)) / 2)


def _saturation(counts: MeanCounts, shape: tuple[int, int]) -> Mapping[str, Any]:
    """Fields of the device that follow from the saturation curve."""
    names = ("efficiency", "dead_time_s", "dead_time_kind", "kind_ratio")
    if len(np.unique(counts.light_hz)) < 3:
        return dict(zip(names, (None, None, None, 0.0), strict=True))
    fit, ratio = fit_saturation(counts)
    errors = _standard_errors(fit.covariance)
    left = misfit(counts, fit)
    if left.is_clear:
        return dict(zip(names, (None, None, None, 0.0), strict=True)) | {"misfit": left.share}
    _, efficiency, dead_time = _estimates(fit.solution, errors, shape)
    # name the kind if there is dead time and the curve determines its kind
    known = errors[:, 2] > 0
    seen = np.sum((fit.solution / errors)[known, 2]) / np.sqrt(max(known.sum(), 1))
    kind = fit.kind if ratio > _CLEAR_KIND and seen > 5 else None
    return dict(zip(names, (efficiency, dead_time, kind, ratio), strict=True))
