"""Exact intervals of a Poisson mean.

Source: F. Garwood, Biometrika 28, 437 (1936).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import chi2

from megalopta.core.arrays import Floats, Mask
from megalopta.sensor.calibrate.comb import HIDDEN_AT, CombFit, Curve, comb_period, fit_comb
from megalopta.sensor.calibrate.level import Adc, Falls, Level, check_levels, falls_of
from megalopta.sensor.calibrate.neighbors import Kernel, mean_kernel, neighbor_kernel
from megalopta.sensor.calibrate.photon_transfer import PhotonTransfer, photon_transfer
from megalopta.sensor.calibrate.saturation import (
    MeanCounts,
    SaturationFit,
    fit_saturation,
    is_kind_clear,
)


def garwood_interval(counts: ArrayLike, confidence: float = 0.95) -> tuple[Floats, Floats]:
    """Return the means between which counts, of any shape, lie with at least this confidence."""
    k = np.asarray(counts, np.float64)
    tail = (1 - confidence) / 2
    low = np.where(k > 0, chi2.ppf(tail, 2 * np.maximum(k, 1e-9)) / 2, 0.0)
    return low, np.asarray(chi2.isf(tail, 2 * (k + 1)) / 2)


_95 = 1.959964


@dataclass(frozen=True, eq=False)
class Estimate:
    """One quantity of every pixel with its 95 % interval, each (rows, columns); NaN: not known."""

    value: Floats
    low: Floats
    high: Floats

    @classmethod
    def normal(cls, value: Floats, error: Floats, shape: tuple[int, int]) -> "Estimate":
        """Of a value with this standard error."""
        error = np.where(error > 0, error, np.nan)
        value, spread = np.where(np.isfinite(error), value, np.nan), _95 * error
        return cls(*(each.reshape(shape) for each in (value, value - spread, value + spread)))

    def with_relative_error(self, error: Floats) -> "Estimate":
        """The same where a factor of it has this relative standard error too; not below 0."""
        spread = np.hypot((self.high - self.low) / 2, _95 * error * self.value)
        return Estimate(self.value, np.maximum(self.value - spread, 0), self.value + spread)

    def scaled(self, factor: Floats | float) -> "Estimate":
        """In another unit."""
        return Estimate(self.value * factor, self.low * factor, self.high * factor)


@dataclass(frozen=True, eq=False)
class Device:
    """What recordings tell of a device.

    Attributes
    ----------
    offset_v, leak_v_s, step_v, read_noise_v, dark_counts_hz : Estimate
        `offset_v` is the fall of the output below the top of the ADC without events or leak:
        positive lowers it, as events do. `AnalogPixels.offset_v` and the map `offset` of a device
        file, which add to the output, have the opposite sign. `leak_v_s` is unknown where the comb
        is hidden.
    efficiency : Estimate or None
        Events per unit of light; None without flat frames.
    dead_time_s : Estimate or None
    dead_time_kind : str or None
        None where the saturation curve does not tell it.
    kind_ratio : float
        Logarithm of the ratio of likelihoods of the two kinds.
    kernel : Kernel or None
        Of crosstalk; None where the comb is hidden.
    hot : (rows, columns) bool
    method : str
        How steps were found: "comb" or "photon transfer".
    counts : MeanCounts
        Behind the saturation curve.
    falls : Falls
    curve : Curve
        How the step changes over the swing.
    slope_error : float
        Standard error of its slope; infinite where it is not told.
    """

    offset_v: Estimate
    leak_v_s: Estimate
    step_v: Estimate
    read_noise_v: Estimate
    dark_counts_hz: Estimate
    efficiency: Estimate | None
    dead_time_s: Estimate | None
    dead_time_kind: str | None
    kind_ratio: float
    kernel: Kernel | None
    hot: Mask
    method: str
    counts: MeanCounts
    falls: Falls
    curve: Curve
    slope_error: float

    @property
    def is_slope_seen(self) -> bool:
        """Whether the step changes over the swing, beyond 3 standard errors."""
        return abs(self.curve.slope) > 3 * self.slope_error

    @property
    def levels(self) -> tuple[tuple[float, float], ...]:
        """Exposure (s) and light of each."""
        return tuple(zip(self.counts.exposure_s, self.counts.light_hz, strict=True))

    def counts_of(self, level: Level, adc: Adc) -> Floats:
        """Counts, not rounded, from the codes of frames (n, rows, columns)."""
        leak = np.nan_to_num(self.leak_v_s.value) * level.exposure_s
        fall = (adc.top - level.codes) * adc.lsb_v
        steps = (fall - self.offset_v.value - leak) / self.step_v.value
        return self.curve.numbers(steps, self.step_v.value)


_WIDEST_SEARCH, _NARROWEST_SEARCH = 0.25, 0.15
_DEVIATIONS_SEARCHED = 5.0
_SHALLOW = 0.12
"""Of the swing: over more of it, a step that changes blurs the comb."""
_LOUDEST = 2.0
"""Times the median residual of the comb; beyond, the fit of a pixel has failed."""
_SURELY = 5.0
_CLEAR_OF_END = 2.0
_SURE_OFFSET = 0.2
"""Standard error of the offset, in steps, above which teeth cannot be told apart."""


def calibrate_device(levels: Sequence[Level], adc: Adc, *, hot_times: float = 10.0) -> Device:
    """Estimate everything that levels of darkness and of light tell, with 95 % intervals.

    Parameters
    ----------
    levels : sequence of Level
        Dark frames of three exposures or more; flat frames of two lights or more, or none.
    adc : Adc
    hot_times : float
        Pixels surely above so many times the median dark counts are hot.

    Raises
    ------
    ValueError
        When the recordings cannot support this (`check_levels`), or when the shortest dark
        exposure is too long to tell where no count lies.
    """
    check_levels(levels, adc)
    shape = levels[0].codes.shape[1:]
    exposure = np.array([level.exposure_s for level in levels])
    light = np.array([level.light_hz for level in levels])
    falls = falls_of(levels, adc)
    transfer = photon_transfer(falls, exposure, light)
    step, noise = _comb(falls, transfer, adc)
    # outputs that the ADC cuts off look like a tooth: the variance knows better
    louder = np.maximum(noise, np.sqrt(transfer.read_variance_v2) / transfer.step_v)
    if np.median(louder) > HIDDEN_AT:
        clear = _CLEAR_OF_END if falls.is_cut else 0.0
        transfer = photon_transfer(falls, exposure, light, above_noise=clear)
        return _without_comb(adc, falls, transfer, exposure, light, shape, hot_times)
    if np.median(transfer.offset_error_v / step) > _SURE_OFFSET:
        raise ValueError(
            "dark frames: the shortest exposure is too long to tell where no count lies; add "
            "shorter ones, with a few counts or none in a frame"
        )
    fit = fit_comb(falls, exposure, step, transfer.offset_v, adc.swing_v)
    if np.median(fit.noise_v / fit.solution[:, 2]) > _LOUDEST * np.median(louder):
        raise ValueError(
            "the teeth of the comb cannot be followed through the swing, as where the step changes "
            "by more than a tenth over it; leave out the levels of most counts"
        )
    return _with_comb(levels, adc, falls, fit, exposure, light, shape, hot_times)


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


def _with_comb(
    levels: Sequence[Level],
    adc: Adc,
    falls: Falls,
    fit: CombFit,
    exposure: Floats,
    light: Floats,
    shape: tuple[int, int],
    hot_times: float,
) -> Device:
    errors = _standard_errors(fit.covariance)
    failed = _failed(fit, errors, falls)
    errors[failed], falls.frames[:, failed] = np.nan, 0
    offset, leak, step = (
        Estimate.normal(fit.solution[:, at], errors[:, at], shape) for at in range(3)
    )
    n = np.maximum(falls.frames, 1)
    counts = MeanCounts(fit.counts / n, falls.frames, exposure, light)
    read = np.sqrt(np.maximum(fit.noise_v**2 - adc.lsb_v**2 / 12, 0))
    read_error = fit.noise_v**2 / np.sqrt(2 * np.maximum(fit.readings, 1)) / np.maximum(read, 1e-12)
    efficiency, dead_time, kind, ratio = _saturation(counts, shape)
    dark = _dark_counts(counts, fit.counts, shape)
    if dead_time is not None and kind is not None:
        # what dead time hides, to first order, is the same for both kinds
        dark = dark.scaled(1 + dark.value * float(np.nanmedian(dead_time.value)))
    hot = dark.low > hot_times * float(np.nanmedian(dark.value))
    device = Device(
        offset,
        leak,
        step,
        Estimate.normal(read, read_error, shape),
        dark,
        efficiency,
        dead_time,
        kind,
        ratio,
        None,
        hot,
        "comb",
        counts,
        falls,
        fit.curve,
        fit.slope_error,
    )
    return _with_kernel(device, levels, adc, fit.is_clear)


def _standard_errors(covariance: Floats) -> Floats:
    return np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0))


def _failed(fit: CombFit, errors: Floats, falls: Falls) -> Mask:
    """Pixels whose teeth were taken for others: too loud, or with a leak that fills them up."""
    failed = ~(fit.noise_v <= _LOUDEST * np.median(fit.noise_v))
    failed |= fit.solution[:, 1] < -_SURELY * errors[:, 1]
    return np.asarray(failed | (falls.frames.sum(axis=0) == 0))


def _dark_counts(counts: MeanCounts, sums: Floats, shape: tuple[int, int]) -> Estimate:
    is_dark = counts.light_hz == 0
    live = (counts.frames * counts.exposure_s[:, None])[is_dark].sum(axis=0)
    total = sums[is_dark].sum(axis=0)
    low, high = garwood_interval(total)
    known = live > 0
    rates = (
        np.where(known, each / np.where(known, live, 1), np.nan) for each in (total, low, high)
    )
    return Estimate(*(each.reshape(shape) for each in rates))


def _saturation(
    counts: MeanCounts, shape: tuple[int, int]
) -> tuple[Estimate | None, Estimate | None, str | None, float]:
    if len(np.unique(counts.light_hz)) < 3:
        return None, None, None, 0.0
    fit, ratio = fit_saturation(counts)
    errors = _standard_errors(fit.covariance)
    efficiency, dead_time = (
        Estimate.normal(fit.solution[:, at], errors[:, at], shape) for at in (1, 2)
    )
    return efficiency, dead_time, _named(fit, errors[:, 2], ratio), ratio


def _named(fit: SaturationFit, error: Floats, ratio: float) -> str | None:
    """The kind, where dead time is there at all and the curve tells its kind."""
    known = error > 0
    seen = np.sum(fit.solution[known, 2] / error[known]) / np.sqrt(max(known.sum(), 1))
    return fit.kind if is_kind_clear(ratio) and seen > 5 else None


def _with_kernel(device: Device, levels: Sequence[Level], adc: Adc, is_clear: bool) -> Device:
    """Add crosstalk and afterpulses, the mean over all dark levels."""
    rows = device.counts.frames.reshape(-1, *device.hot.shape)
    usable = {at: rows[at] > 0 for at, level in enumerate(levels) if level.is_dark}
    kernels = []
    for at, good in usable.items():
        # pixels whose fit has failed have no counts
        counts = np.nan_to_num(np.rint(device.counts_of(levels[at], adc)))
        try:
            kernels.append(neighbor_kernel(counts, good & (counts.mean(axis=0) > 0)))
        except ValueError:
            continue  # too few pixels are left at this exposure
    if not kernels:
        return device
    kernel = mean_kernel(kernels)
    # readings that noise puts to the next tooth vary as afterpulses do
    return replace(device, kernel=kernel if is_clear else kernel.without_afterpulses)


def _without_comb(
    adc: Adc,
    falls: Falls,
    transfer: PhotonTransfer,
    exposure: Floats,
    light: Floats,
    shape: tuple[int, int],
    hot_times: float,
) -> Device:
    """From photon transfer alone: what leaks counts as dark counts."""
    mean = (falls.mean_v - transfer.offset_v) / transfer.step_v
    noise = transfer.read_variance_v2 / transfer.step_v**2
    counts = MeanCounts(mean, falls.frames, exposure, light, noise)
    dark = _dark_counts(counts, np.maximum(mean, 0) * falls.frames, shape)
    dark = dark.with_relative_error((transfer.step_error_v / transfer.step_v).reshape(shape))
    efficiency, dead_time, kind, ratio = _saturation(counts, shape)
    unknown = np.full(shape, np.nan)
    read = np.sqrt(transfer.read_variance_v2)
    return Device(
        Estimate.normal(transfer.offset_v, transfer.offset_error_v, shape),
        Estimate(unknown, unknown, unknown),
        Estimate.normal(transfer.step_v, transfer.step_error_v, shape),
        Estimate(read.reshape(shape), unknown, unknown),
        dark,
        efficiency,
        dead_time,
        kind,
        ratio,
        None,
        dark.low > hot_times * float(np.nanmedian(dark.value)),
        "photon transfer",
        counts,
        falls,
        Curve(adc.swing_v),
        np.inf,
    )
