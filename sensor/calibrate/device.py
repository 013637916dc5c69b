"""A device from its recordings: all estimators, one after the other."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import chi2

from megalopta.core.arrays import Floats, Mask
from megalopta.sensor.calibrate.comb import HIDDEN_AT, CombFit, Curve, comb_period, fit_comb
from megalopta.sensor.calibrate.level import (
    Adc,
    Falls,
    Level,
    PhotonTransfer,
    check_levels,
    falls_of,
    photon_transfer,
)
from megalopta.sensor.calibrate.neighbors import Kernel, mean_kernel, neighbor_kernel
from megalopta.sensor.calibrate.saturation import MeanCounts, fit_saturation

_95 = 1.959964
_WIDEST_SEARCH, _NARROWEST_SEARCH = 0.25, 0.15
_DEVIATIONS_SEARCHED = 5.0
_SHALLOW = 0.12
"""Of the swing: over more of it, a step that changes blurs the comb."""
_LOUDEST = 2.0
"""Times the median residual of the comb; beyond, the fit of a pixel has failed."""
_SURELY = 5.0
_CLEAR_OF_END = 2.0
_SURE_OFFSET = 0.2
"""Standard error of the offset, in steps, above which teeth cannot be distinguished."""
_CLEAR_KIND = 6.0
"""Logarithm of the ratio of likelihoods above which the kind of dead time is named."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """One quantity of every pixel with its 95 % interval, each (rows, columns); NaN: not known."""

    value: Floats
    low: Floats
    high: Floats

    @classmethod
    def normal(cls, value: Floats, error: Floats, shape: tuple[int, int]) -> "Estimate":
        """Return a value with the interval of this standard error."""
        error = np.where(error > 0, error, np.nan)
        value, spread = np.where(np.isfinite(error), value, np.nan), _95 * error
        return cls(*(each.reshape(shape) for each in (value, value - spread, value + spread)))

    def with_relative_error(self, error: Floats) -> "Estimate":
        """Return it where a factor has this relative standard error, too; not below 0."""
        spread = np.hypot((self.high - self.low) / 2, _95 * error * self.value)
        return Estimate(self.value, np.maximum(self.value - spread, 0), self.value + spread)

    def scaled(self, factor: Floats | float) -> "Estimate":
        """Return it in another unit."""
        return Estimate(self.value * factor, self.low * factor, self.high * factor)


@dataclass(frozen=True, eq=False, kw_only=True)
class Device:
    """Estimates of a device, and what they rest on."""

    offset_v: Estimate
    """Fall of the output below the top of the ADC without events or leak: positive lowers it, as
    events do. `AnalogPixels.offset_v` and the map `offset` of a device file, which add to the
    output, have the opposite sign."""
    leak_v_s: Estimate
    """Unknown where the comb is hidden"""
    step_v: Estimate
    read_noise_v: Estimate
    dark_counts_hz: Estimate
    efficiency: Estimate | None
    """Events per unit of light; None without flat frames"""
    dead_time_s: Estimate | None
    dead_time_kind: str | None
    """None where the saturation curve does not tell it"""
    kind_ratio: float
    """Logarithm of the ratio of likelihoods of the two kinds"""
    kernel: Kernel | None = None
    """Of crosstalk; None where the comb is hidden"""
    hot: Mask
    """(rows, columns)"""
    method: str
    """By which steps were found, "comb" or "photon transfer" """
    counts: MeanCounts
    """Behind the saturation curve"""
    falls: Falls
    curve: Curve
    """How the step changes over the swing"""
    slope_error: float
    """Standard error of its slope; infinite where it is not determined"""

    @property
    def is_slope_seen(self) -> bool:
        """True where the step changes over the swing, beyond 3 standard errors."""
        return abs(self.curve.slope) > 3 * self.slope_error

    @property
    def levels(self) -> tuple[tuple[float, float], ...]:
        """Exposure (s) and light of each."""
        return tuple(zip(self.counts.exposure_s, self.counts.light_hz, strict=True))

    def counts_of(self, level: Level, adc: Adc) -> Floats:
        """Counts, not rounded, from the codes of frames (n, rows, columns)."""
        leak = np.nan_to_num(self.leak_v_s.value) * level.exposure_s
        fall = (adc.top - level.readings) * adc.lsb_v
        steps = (fall - self.offset_v.value - leak) / self.step_v.value
        return self.curve.numbers(steps, self.step_v.value)


class _Recorded(NamedTuple):
    """Recordings of all levels, and what is asked of them."""

    levels: Sequence[Level]
    adc: Adc
    hot_times: float
    falls: Falls

    @property
    def shape(self) -> tuple[int, int]:
        rows, columns = self.levels[0].readings.shape[1:]
        return rows, columns

    def estimates(self, solution: Floats, errors: Floats) -> list[Estimate]:
        """Estimates of the columns of a solution (P, k)."""
        return [
            Estimate.normal(*each, self.shape) for each in zip(solution.T, errors.T, strict=True)
        ]

    def mean_counts(self, mean: Floats, noise: Floats | float = 0.0) -> MeanCounts:
        falls = self.falls
        return MeanCounts(mean, falls.frames, falls.exposure_s, falls.light_hz, noise)

    def hot(self, dark: Estimate) -> Mask:
        return np.asarray(dark.low > self.hot_times * float(np.nanmedian(dark.value)))


def calibrate_device(levels: Sequence[Level], adc: Adc, *, hot_times: float = 10.0) -> Device:
    """Estimate everything that levels of darkness and of light tell, with 95 % intervals.

    Parameters
    ----------
    levels : sequence of Level
        Dark frames of three exposures or more; flat frames of two lights or more, or none.
    hot_times : float
        Pixels surely above so many times the median dark counts are hot.

    Raises ValueError when the recordings cannot support this (`check_levels`), or when the shortest
    dark exposure is too long to tell where no count lies.
    """
    check_levels(levels, adc)
    falls = falls_of(levels, adc)
    recorded = _Recorded(levels, adc, hot_times, falls)
    transfer = photon_transfer(falls)
    step, noise = _comb(falls, transfer, adc)
    # outputs that the ADC cuts off look like a tooth: the variance knows better
    louder = np.maximum(noise, np.sqrt(transfer.read_variance_v2) / transfer.step_v)
    if np.median(louder) > HIDDEN_AT:
        clear = _CLEAR_OF_END if falls.is_cut else 0.0
        transfer = photon_transfer(falls, above_noise=clear)
        return _without_comb(recorded, transfer)
    if np.median(transfer.offset_error_v / step) > _SURE_OFFSET:
        raise ValueError(
            "dark frames: the shortest exposure is too long to tell where no count lies; add "
            "shorter ones, with a few counts or none in a frame"
        )
    fit = fit_comb(falls, step, transfer.offset_v, adc.swing_v)
    if np.median(fit.noise_v / fit.solution[:, 2]) > _LOUDEST * np.median(louder):
        raise ValueError(
            "the teeth of the comb cannot be followed through the swing, as where the step changes "
            "by more than a tenth over it; leave out the levels of most counts"
        )
    return _with_comb(recorded, fit)


def _comb(falls: Falls, transfer: PhotonTransfer, adc: Adc) -> tuple[Floats, Floats]:
    steps = transfer.step_v
    typical = float(np.median(steps))
    low, high = np.percentile(steps, (16, 84)) / typical
    error = float(np.median(transfer.step_error_v)) / typical
    scatter = np.sqrt(max(((high - low) / 2) ** 2 - error**2, 0.0))
    within = _DEVIATIONS_SEARCHED * max(scatter, error / np.sqrt(steps.size))
    within = float(np.clip(within, _NARROWEST_SEARCH, _WIDEST_SEARCH))
    is_shallow = falls.mean_v[falls.level, falls.pixel] < _SHALLOW * adc.swing_v
    return comb_period(falls.at(is_shallow), np.full(steps.size, typical), within)


def _with_comb(recorded: _Recorded, fit: CombFit) -> Device:
    falls, shape = recorded.falls, recorded.shape
    errors = _standard_errors(fit.covariance)
    failed = _failed(fit, errors, falls)
    errors[failed], falls.frames[:, failed] = np.nan, 0
    offset, leak, step = recorded.estimates(fit.solution, errors)
    counts = recorded.mean_counts(fit.counts / np.maximum(falls.frames, 1))
    read = np.sqrt(np.maximum(fit.noise_v**2 - recorded.adc.lsb_v**2 / 12, 0))
    read_error = fit.noise_v**2 / np.sqrt(2 * np.maximum(fit.readings, 1)) / np.maximum(read, 1e-12)
    saturation = _saturation(recorded, counts)
    dark = _dark_counts(counts, fit.counts, shape)
    if saturation["dead_time_kind"]:
        # what dead time hides, to first order, is the same for both kinds
        dark = dark.scaled(1 + dark.value * float(np.nanmedian(saturation["dead_time_s"].value)))
    device = Device(
        offset_v=offset,
        leak_v_s=leak,
        step_v=step,
        read_noise_v=Estimate.normal(read, read_error, shape),
        dark_counts_hz=dark,
        hot=recorded.hot(dark),
        method="comb",
        counts=counts,
        falls=falls,
        curve=fit.curve,
        slope_error=fit.slope_error,
        **saturation,
    )
    return _with_kernel(device, recorded, fit.is_clear)


def _without_comb(recorded: _Recorded, transfer: PhotonTransfer) -> Device:
    """A device from photon transfer alone: what leaks counts as dark counts."""
    falls, shape = recorded.falls, recorded.shape
    mean = (falls.mean_v - transfer.offset_v) / transfer.step_v
    counts = recorded.mean_counts(mean, transfer.read_variance_v2 / transfer.step_v**2)
    dark = _dark_counts(counts, np.maximum(mean, 0) * falls.frames, shape)
    dark = dark.with_relative_error((transfer.step_error_v / transfer.step_v).reshape(shape))
    unknown = np.full(shape, np.nan)
    read = np.sqrt(transfer.read_variance_v2)
    return Device(
        offset_v=Estimate.normal(transfer.offset_v, transfer.offset_error_v, shape),
        leak_v_s=Estimate(unknown, unknown, unknown),
        step_v=Estimate.normal(transfer.step_v, transfer.step_error_v, shape),
        read_noise_v=Estimate(read.reshape(shape), unknown, unknown),
        dark_counts_hz=dark,
        hot=recorded.hot(dark),
        method="photon transfer",
        counts=counts,
        falls=falls,
        curve=Curve(recorded.adc.swing_v),
        slope_error=np.inf,
        **_saturation(recorded, counts),
    )


def _standard_errors(covariance: Floats) -> Floats:
    return np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0))


def _failed(fit: CombFit, errors: Floats, falls: Falls) -> Mask:
    """Pixels whose teeth were taken for others: too loud, or with a leak that fills them up."""
    failed = ~(fit.noise_v <= _LOUDEST * np.median(fit.noise_v))
    failed |= fit.solution[:, 1] < -_SURELY * errors[:, 1]
    return np.asarray(failed | (falls.frames.sum(axis=0) == 0))


def garwood_interval(counts: Floats) -> tuple[Floats, Floats]:
    """Return the Poisson means between which counts, of any shape, lie with 95 % or more.

    F. Garwood, Biometrika 28, 437 (1936).
    """
    low = np.where(counts > 0, chi2.ppf(0.025, 2 * np.maximum(counts, 1e-9)) / 2, 0.0)
    return low, np.asarray(chi2.isf(0.025, 2 * (counts + 1)) / 2)


def _dark_counts(counts: MeanCounts, sums: Floats, shape: tuple[int, int]) -> Estimate:
    is_dark = counts.light_hz == 0
    live = (counts.frames * counts.exposure_s[:, None])[is_dark].sum(axis=0)
    total = sums[is_dark].sum(axis=0)
    rates = np.stack([total, *garwood_interval(total)]) / np.where(live > 0, live, np.nan)
    return Estimate(*rates.reshape(3, *shape))


def _saturation(recorded: _Recorded, counts: MeanCounts) -> Mapping[str, Any]:
    """Fields of the device that the saturation curve tells."""
    names = ("efficiency", "dead_time_s", "dead_time_kind", "kind_ratio")
    if len(np.unique(counts.light_hz)) < 3:
        return dict(zip(names, (None, None, None, 0.0), strict=True))
    fit, ratio = fit_saturation(counts)
    errors = _standard_errors(fit.covariance)
    _, efficiency, dead_time = recorded.estimates(fit.solution, errors)
    # the kind, where dead time is there at all and the curve tells its kind
    known = errors[:, 2] > 0
    seen = np.sum((fit.solution / errors)[known, 2]) / np.sqrt(max(known.sum(), 1))
    kind = fit.kind if ratio > _CLEAR_KIND and seen > 5 else None
    return dict(zip(names, (efficiency, dead_time, kind, ratio), strict=True))


def _with_kernel(device: Device, recorded: _Recorded, is_clear: bool) -> Device:
    """Add crosstalk and afterpulses, the mean over all dark levels."""
    kernels = []
    for level, frames in zip(recorded.levels, device.counts.frames, strict=True):
        if not level.is_dark:
            continue
        # pixels whose fit has failed have no counts
        counts = np.nan_to_num(np.rint(device.counts_of(level, recorded.adc)))
        good = (frames.reshape(recorded.shape) > 0) & (counts.mean(axis=0) > 0)
        try:
            kernels.append(neighbor_kernel(counts, good))
        except ValueError:
            continue  # too few pixels are left at this exposure
    if not kernels:
        return device
    kernel = mean_kernel(kernels)
    # readings that noise puts to the next tooth vary as afterpulses do
    return replace(device, kernel=kernel if is_clear else kernel.without_afterpulses)
