"""A device from its recordings: all estimators in sequence."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.stats import chi2

from megalopta.core.arrays import Floats, Mask
from megalopta.sensor.calibrate.comb import HIDDEN_AT, CombFit, Curve, comb_period, fit_comb
from megalopta.sensor.calibrate.crosstalk import Kernel, mean_kernel, neighbor_kernel
from megalopta.sensor.calibrate.level import Drops, Level, check_levels, drops_of, photon_transfer
from megalopta.sensor.calibrate.pixels import hot_pixels
from megalopta.sensor.calibrate.saturation import MeanCounts, fit_saturation, misfit
from megalopta.sensor.spad.counters import AnalogCounter

_95 = 1.959964
_LOUDEST = 2.0
"""Residual, relative to the comb's median, above which a pixel's fit has failed."""


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
        return cls(*(end.reshape(shape) for end in (value, value - spread, value + spread)))

    @property
    def median(self) -> float:
        """Median over the known pixels; NaN if none is known."""
        return float(np.nanmedian(self.value)) if np.isfinite(self.value).any() else np.nan

    def where(self, known: Mask, value: float = np.nan) -> "Estimate":
        """Return the estimate with another value, and interval, where it is not known."""
        ends = self.value, self.low, self.high
        return Estimate(*(np.where(known, end, value) for end in ends))

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
    efficiency: Estimate | None = None
    """Events per unit of light; None without flat frames"""
    dead_time_s: Estimate | None = None
    dead_time_kind: str | None = None
    """None if the saturation curve does not determine it"""
    kind_ratio: float = 0.0
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
    drops: Drops
    curve: Curve
    """Change of the step over the swing"""
    slope_error: float
    """Standard error of its slope; infinite if it is not determined"""

    @property
    def is_slope_seen(self) -> bool:
        """True if the step changes over the swing, beyond 3 standard errors."""
        return abs(self.curve.slope) > 3 * self.slope_error


def calibrate_device(levels: Sequence[Level], counter: AnalogCounter) -> Device:
    """Estimate all parameters that dark and lit levels determine, with 95 % CI.

    Parameters
    ----------
    levels : sequence of Level
        Dark frames at three or more exposures; flat frames at two or more light levels, or none.
    counter : AnalogCounter
        Its supply, swing and ADC.

    Raises ValueError if the recordings are insufficient (`check_levels`), or the shortest dark
    exposure is too long to determine the level of no counts.
    """
    check_levels(levels, counter)
    shape = levels[0].readings.shape[1], levels[0].readings.shape[2]
    drops = drops_of(levels, counter)
    fit = _fitted_comb(drops, counter)
    errors = _standard_errors(fit.covariance)
    failed = _misassigned(drops, fit, errors)
    errors[failed], drops.frames[:, failed] = np.nan, 0
    offset, leak, step = _estimates(fit.solution, errors, shape)
    read_v = np.sqrt(np.maximum(fit.noise_v**2 - counter.lsb_v**2 / 12, 0))
    read_error = fit.noise_v**2 / np.sqrt(2 * np.maximum(fit.readings, 1))
    mean = fit.counts / np.maximum(drops.frames, 1)
    counts = MeanCounts(mean, drops.frames, drops.exposure_s, drops.light_hz)
    of_light = _efficiency_and_dead_time(counts, shape)
    dark = _dark_counts(fit, counts, shape)
    if of_light.get("dead_time_kind"):
        # to first order, both kinds of dead time hide the same counts
        dark = dark.scaled(1 + dark.value * of_light["dead_time_s"].median)
    device = Device(
        offset_v=offset, leak_v_s=leak, step_v=step, dark_counts_hz=dark,
        read_noise_v=Estimate.normal(read_v, read_error / np.maximum(read_v, 1e-12), shape),
        hot=hot_pixels(dark.low, dark.value, dark.high), counts=counts, drops=drops,
        curve=fit.curve, slope_error=fit.slope_error, **of_light,
    )  # fmt: skip
    kernel = _crosstalk(device, levels, counter)
    # readings that noise moves to the next peak vary as afterpulses do
    if kernel and not fit.is_clear:
        kernel = kernel._replace(afterpulses=np.nan, afterpulses_error=np.nan)
    return replace(device, kernel=kernel)


def _fitted_comb(drops: Drops, counter: AnalogCounter) -> CombFit:
    """Comb of each pixel, with steps about as by photon transfer, then by its period."""
    transfer = photon_transfer(drops)
    typical_v = float(np.median(transfer.step_v))
    low, high = np.percentile(transfer.step_v, (16, 84)) / typical_v
    error = float(np.median(transfer.step_error_v)) / typical_v
    scatter = np.sqrt(max(((high - low) / 2) ** 2 - error**2, 0.0))
    within = 5.0 * max(scatter, error / np.sqrt(transfer.step_v.size))
    within = float(np.clip(within, 0.15, 0.25))
    # below, a changing step blurs the comb
    is_shallow = drops.mean_v[drops.level, drops.pixel] < 0.12 * counter.swing_v
    step_v, noise = comb_period(drops.at(is_shallow), typical_v, within)
    # outputs that the ADC cuts off look like a peak; the variance reveals them
    noise = np.maximum(noise, np.sqrt(transfer.read_variance_v2) / transfer.step_v)
    if np.median(noise) > HIDDEN_AT:
        raise ValueError(
            f"read noise of {np.median(noise):.2g} steps hides single events; lower it to "
            f"{HIDDEN_AT:g} or less, or calibrate from counts"
        )
    # in steps: peaks cannot be distinguished
    if np.median(transfer.offset_error_v / step_v) > 0.2:
        raise ValueError(
            "dark frames: the shortest exposure is too long to find the reading of no counts; add "
            "shorter ones, with few or no counts per frame"
        )
    fit = fit_comb(drops, step_v, transfer.offset_v, counter.swing_v)
    if np.median(fit.noise_v / fit.solution[:, 2]) > _LOUDEST * np.median(noise):
        raise ValueError(
            "the peaks of the comb cannot be followed through the swing, as if the step changed by "
            "more than a tenth over it; omit the levels with most counts"
        )
    return fit


def _misassigned(drops: Drops, fit: CombFit, errors: Floats) -> Mask:
    """Pixels whose peaks were misassigned: too noisy, with an implausible leak, or never used."""
    leak_v_s = fit.solution[:, 1]
    failed = ~(fit.noise_v <= _LOUDEST * np.median(fit.noise_v))
    failed |= leak_v_s < -5.0 * errors[:, 1]
    # peaks that are off by whole counts at the longest exposure look like leak
    distance = np.abs(leak_v_s - np.median(leak_v_s))
    failed |= distance > 40.0 * np.median(distance)
    return np.asarray(failed | (drops.frames.sum(axis=0) == 0))


def _efficiency_and_dead_time(counts: MeanCounts, shape: tuple[int, int]) -> dict[str, Any]:
    """Fields of a device that its saturation curve determines."""
    if len(np.unique(counts.light_hz)) < 3:
        return {}
    curves, ratio = fit_saturation(counts)
    residual = misfit(counts, curves)
    if residual.is_clear:
        return {"misfit": residual.share}
    errors = _standard_errors(curves.covariance)
    _, efficiency, dead_time = _estimates(curves.solution, errors, shape)
    # name the kind if there is dead time and the curve determines its kind
    known = errors[:, 2] > 0
    z = (curves.solution / errors)[known, 2]
    is_seen = np.sum(z) / np.sqrt(max(known.sum(), 1)) > 5
    kind = curves.kind if ratio > 6.0 and is_seen else None
    return {
        "efficiency": efficiency,
        "dead_time_s": dead_time,
        "dead_time_kind": kind,
        "kind_ratio": ratio,
    }


def _dark_counts(fit: CombFit, counts: MeanCounts, shape: tuple[int, int]) -> Estimate:
    """Rates of all dark frames, with exact intervals."""
    is_dark = counts.light_hz == 0
    live_s = (counts.frames * counts.exposure_s[:, None])[is_dark].sum(axis=0)
    total = fit.counts[is_dark].sum(axis=0)
    rates = np.stack([total, *garwood_interval(total)]) / np.where(live_s > 0, live_s, np.nan)
    return Estimate(*rates.reshape(3, *shape))


def _crosstalk(device: Device, levels: Sequence[Level], counter: AnalogCounter) -> Kernel | None:
    """Crosstalk and afterpulses, by coincidences of dark counts."""
    step_v, kernels = device.step_v.value, []
    for level, frames in zip(levels, device.counts.frames, strict=True):
        if level.is_dark:
            drop_v = counter.supply_v - level.readings * counter.lsb_v
            leaked_v = np.nan_to_num(device.leak_v_s.value) * level.exposure_s
            numbers = device.curve.numbers(
                (drop_v - device.offset_v.value - leaked_v) / step_v, step_v
            )
            # pixels with a failed fit have no counts
            readings = np.nan_to_num(np.rint(numbers))
            good = (frames.reshape(step_v.shape) > 0) & (readings.mean(axis=0) > 0)
            with suppress(ValueError):  # too few pixels remain at this exposure
                kernels.append(neighbor_kernel(readings, good))
    return mean_kernel(kernels) if kernels else None


def _estimates(solution: Floats, errors: Floats, shape: tuple[int, int]) -> list[Estimate]:
    return [Estimate.normal(*column, shape) for column in zip(solution.T, errors.T, strict=True)]


def _standard_errors(covariance: Floats) -> Floats:
    return np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0))


def garwood_interval(counts: Floats) -> tuple[Floats, Floats]:
    """Return the Poisson means between which counts, of any shape, lie with at least 95 %.

    F. Garwood, Biometrika 28, 437 (1936).
    """
    low = np.where(counts > 0, chi2.ppf(0.025, 2 * np.maximum(counts, 1e-9)) / 2, 0.0)
    return low, np.asarray(chi2.isf(0.025, 2 * (counts + 1)) / 2)
