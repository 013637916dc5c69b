"""Device of a counting or binary camera, from recordings in the dark and under uniform light.

Arrivals of rate r = d + η·φ, with d dark counts, η the efficiency and φ the light, make mean counts
M(r), without dead time r·T. Of binary frames a share p = 1 − exp(−r·T) is 1, whatever the dead
time; so r = −ln(1 − p)/T, with the variance p/((1 − p)·n)/T² of n frames.

    dark counts    exact intervals of Poisson or binomial sums (Garwood; Clopper and Pearson),
                   through the inverse of M; needs the dark
    dead time      saturation curve (`saturation`) of 2048 pixels at most; needs counts, two lights
    efficiency     weighted line through rates over light; needs light, and the dark or two lights
    bad pixels     dead: no counts under light; stuck: one reading in all frames; saturated in every
                   recording. Hot: dark counts surely above ten times the median
    telegraph      readings in the dark correlated from frame to frame (`telegraph`), with the two
                   rates between which dark counts switch

Variance beyond that of independent events (afterpulses, crosstalk), by its mean over the array,
widens intervals. The uncertainty of the dead time is part of those of rates. Crosstalk and
afterpulses, p per avalanche, make arrivals a = r + p·m from m counted avalanches per second, fewer
of which come from busy pixels: lights are scaled to a, by (1 − p)/(1 − p·m/a), before dead time is
fitted. A dead time whose curve does not fit is not stated. Pixels of a level are
omitted where a counter was at its capacity, or fewer than ten binary frames were 0.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.stats import beta

from megalopta.core.arrays import Floats, Ints, Mask
from megalopta.sensor.calibrate.bad_pixels import dead_pixels, hot_pixels
from megalopta.sensor.calibrate.device import Estimate, garwood_interval
from megalopta.sensor.calibrate.neighbors import Kernel, mean_kernel
from megalopta.sensor.calibrate.saturation import (
    DeadTimeKind,
    MeanCounts,
    Misfit,
    SaturationFit,
    dead_time_moments,
    fit_saturation,
    live_share,
    misfit,
)
from megalopta.sensor.calibrate.sums import Summed
from megalopta.sensor.calibrate.telegraph import switching

_FEWEST_ZEROS = 10
_BRIGHTER_Z = 6.0
_MOST_FITTED = 2048
_SEEN, _CLEAR_KIND = 5.0, 6.0
_NOT_LINEAR = 8.0
_SURE, _OF_MEDIAN = 4.0, 1.2533
_HIDDEN = 0.36
"""Error of the dead time over afterpulses per event: half of what those lost in it, of a delay not
shorter than it, extend a paralyzable one"""
_PILED = 0.5
"""Share of frames at the largest reading of all that shows it to be the counter's capacity."""
_GRID = 4000
_LARGEST_STEP = 50.0
"""Largest ratio of two levels of dark counts that data can distinguish from an infinite one."""
_ROUNDS = 4
_95 = 1.959964


class Switching(NamedTuple):
    """Pixels whose dark counts switch between two rates (rows, columns)."""

    pixels: Mask
    low_hz: Floats
    high_hz: Floats
    time_s: float
    """Correlation time"""


class DeadTimeEstimate(NamedTuple):
    """Dead time of the array."""

    seconds: float
    error: float
    kind: DeadTimeKind
    is_kind_clear: bool


@dataclass(frozen=True, eq=False, kw_only=True)
class CountingDevice:
    """Estimates of a counting or binary camera."""

    dark_counts_hz: Estimate | None
    efficiency: Estimate | None
    """Events per unit of light"""
    dead_time: DeadTimeEstimate | None
    capacity: int | None
    """Largest count; None if it was not reached"""
    dead: Mask
    stuck: Mask
    reading: Floats
    """Reading of stuck and dead pixels (rows, columns); -1: the pixel works"""
    telegraph: Switching | None
    kernel: Kernel | None
    """Crosstalk and afterpulses by coincidences of dark counts"""
    saturated: Mask
    """Usable in no recording"""
    hot: Mask
    refused: Mapping[str, str] = field(default_factory=dict)
    """Why an estimate is missing, by its name"""

    @property
    def bad(self) -> Mask:
        """Pixels that show no light."""
        return self.dead | self.stuck | self.saturated


def calibrate_counts(
    levels: Sequence[Summed], known: tuple[float, DeadTimeKind] | None = None,
    *, hot_times: float = 10.0,
) -> CountingDevice:  # fmt: skip
    """Estimate what the recordings determine, with 95 % CI.

    Parameters
    ----------
    levels : sequence of Summed
        Recordings of one camera.
    known : (seconds, kind), optional
        Dead time that corrects counts if recordings do not determine it.
    hot_times : float
        Pixels surely above this many times the median dark counts are hot.

    Raises ValueError if recordings are of different arrays, or light has no effect.
    """
    _check(levels)
    fits = _Fits(levels)
    kernels = [level.kernel for level in levels if level.kernel is not None]
    kernel = mean_kernel(kernels) if kernels else None
    dead_time, refused = fits.dead_time(kernel)
    fits.applied = dead_time
    if dead_time is None and known is not None and not levels[0].is_binary:
        fits.applied = DeadTimeEstimate(known[0], 0.0, known[1], True)
    dark = fits.dark_counts(refused)
    hot = np.zeros(fits.shape, np.bool_)
    if dark is not None:
        hot = hot_pixels(dark.low, dark.value, dark.high, hot_times)
        hot |= np.isnan(dark.value)  # saturated in the dark
    telegraph, efficiency = fits.telegraph(), fits.efficiency(refused)
    if telegraph is not None and efficiency is not None:
        # how many of their counts under light were dark ones is not known
        maps = efficiency.value, efficiency.low, efficiency.high
        efficiency = Estimate(*(np.where(telegraph.pixels, np.nan, each) for each in maps))
    return CountingDevice(
        dark_counts_hz=dark,
        efficiency=efficiency,
        dead_time=dead_time,
        capacity=fits.capacity,
        dead=fits.dead,
        stuck=fits.stuck,
        reading=np.where(fits.stuck, levels[0].largest, np.where(fits.dead, 0.0, -1.0)),
        telegraph=telegraph,
        kernel=kernel,
        saturated=~np.logical_or.reduce(fits.used) & ~fits.dead & ~fits.stuck,
        hot=hot & ~fits.dead & ~fits.stuck,
        refused=refused,
    )


def _check(levels: Sequence[Summed]) -> None:
    shapes = sorted({level.total.shape for level in levels})
    if len(shapes) != 1:
        raise ValueError(f"recordings of {shapes} pixels; give frames of one device")
    if len({level.is_binary for level in levels}) > 1:
        raise ValueError("recordings of counts and of bits; give frames of one kind")
    dark = [level for level in levels if not level.light_hz]
    for level in levels:
        if level.light_hz and dark:
            longest = max(dark, key=lambda each: each.exposure_s)
            rates = [float(np.median(each.mean)) / each.exposure_s for each in (level, longest)]
            full = level.is_binary and rates[1] * longest.exposure_s > 0.9
            spread = float(np.sqrt(level.variance.mean() / level.frames / level.total.size))
            if not full and (rates[0] - rates[1]) * level.exposure_s < _BRIGHTER_Z * spread:
                raise ValueError(
                    f"{level}: no brighter than the dark; uncover the sensor or raise the light"
                )


class _Fits:
    """Estimators on the same recordings."""

    def __init__(self, levels: Sequence[Summed]) -> None:
        self.levels = levels
        self.shape = levels[0].total.shape
        self.is_binary = levels[0].is_binary
        self.capacity = 1 if self.is_binary else self._capacity()
        lit = [level for level in levels if level.light_hz] or list(levels)
        counts = np.sum([level.total for level in lit], axis=0)
        frozen = np.logical_and.reduce([level.is_constant for level in levels])
        frozen &= np.logical_and.reduce([level.largest == levels[0].largest for level in levels])
        self.dead = dead_pixels(counts, np.full(self.shape, float(np.median(counts))))
        self.dead |= frozen & (counts == 0) & (np.median(counts) > _FEWEST_ZEROS)
        self.stuck = frozen & ~self.dead & (counts > 0)
        bad = self.dead | self.stuck
        self.used = [self._within(level) & ~bad for level in levels]
        self.applied: DeadTimeEstimate | None = None  # to correct rates
        self.spread = [self._excess(*each) for each in zip(levels, self.used, strict=True)]

    def _capacity(self) -> int | None:
        """Largest reading of all, if some pixel piles up there while readings vary elsewhere."""
        top = max(float(level.largest.max()) for level in self.levels)
        piled = [
            ((each.largest == top) & (each.at_largest > _PILED * each.frames)).mean()
            for each in self.levels
        ]
        several = (
            sum(share > 0 for share in piled) > 1 or max(piled) > 2 / self.levels[0].total.size
        )
        return int(top) if top > 1 and several else None

    def _within(self, level: Summed) -> Mask:
        """Pixels whose readings are not limited by the counter."""
        if self.is_binary:
            return np.asarray(level.frames - level.total >= _FEWEST_ZEROS)
        if self.capacity is None:
            return np.ones(self.shape, np.bool_)
        return np.asarray(level.largest < self.capacity)

    def _excess(self, level: Summed, used: Mask) -> float:
        """Variance over that of independent events, by the mean of the array; at least 1."""
        if self.is_binary or not used.any():
            return 1.0
        ratio = float(level.variance[used].sum() / max(level.mean[used].sum(), 1e-300))
        error = float(np.sqrt(2 / level.frames / used.sum() + 1 / max(level.total[used].sum(), 1)))
        return ratio if ratio > 1 + 3 * error else 1.0

    def dead_time(self, kernel: Kernel | None) -> tuple[DeadTimeEstimate | None, dict[str, str]]:
        """Dead time from the saturation curve, or why there is none.

        Busy neighbors fire fewer others, and busy pixels count fewer afterpulses: lights are scaled
        to all arrivals. How many afterpulses the dead time hides depends on their delay, which
        frames do not show.
        """
        if self.is_binary:
            return None, {"dead time": "bits do not show it; give that of the data sheet"}
        lit = [at for at, level in enumerate(self.levels) if level.light_hz]
        several = np.sum([self.used[at] for at in lit], axis=0) > 1 if lit else np.zeros(0)
        good = np.flatnonzero(several)
        if len({self.levels[at].light_hz for at in lit}) < 2 or not good.size:
            text = "needs counts under two lights, the brighter of which loses some to it"
            return None, {"dead time": text}
        if self.nonlinearity() < _SEEN:
            return None, {"dead time": "no counts are lost to it; record brighter light"}
        some = good[np.linspace(0, good.size - 1, min(good.size, _MOST_FITTED)).astype(int)]
        fired, unsure = kernel.echoes if kernel else (0.0, 0.0)
        found, left, live = self._saturation(some, fired, 1.0, _ROUNDS if fired else 1)
        if left.is_clear:
            return None, {
                "dead time": f"{found.kind}, {1e9 * found.seconds:.3g} ns, fits best, but counts "
                f"differ from its curve by {100 * left.share:+.2g} %, as with recharging, twilight "
                "pulses, or lights that are not as stated; no interval holds"
            }
        if kernel:
            more = self._saturation(some, fired + unsure, live, 1)[0]
            hidden = _HIDDEN * (kernel.afterpulses + unsure) * found.seconds
            error = np.hypot(more.seconds - found.seconds, max(hidden, 0.0))
            found = found._replace(
                error=float(np.hypot(found.error, error)),
                is_kind_clear=found.is_kind_clear and more.kind == found.kind,
            )
        scales = (1 - fired) / (1 - fired * np.asarray(live)) * np.ones(len(self.levels))
        self.levels = [
            level._replace(light_hz=float(scale) * level.light_hz)
            for level, scale in zip(self.levels, scales, strict=True)
        ]
        return found, {}

    def _saturation(
        self, some: Ints, fired: float, live: Floats | float, rounds: int
    ) -> tuple[DeadTimeEstimate, Misfit, Floats | float]:
        """Dead time of some pixels, its misfit, and the shares of arrivals counted at each level.

        Lights are scaled for so many `fired` events per avalanche, with these shares at first.
        """
        mean = np.array([each.mean.ravel()[some] for each in self.levels])
        frames = [np.where(used.ravel()[some], each.frames, 0)
                  for used, each in zip(self.used, self.levels, strict=True)]  # fmt: skip
        times, given = np.array([(each.exposure_s, each.light_hz) for each in self.levels]).T
        for _ in range(rounds):
            light = given * (1 - fired) / (1 - fired * live)
            counts = MeanCounts(mean, np.array(frames, np.float64), times, light)
            fit, ratio = fit_saturation(counts, lambda fits: _pooled(fits)[0])
            live = np.nanmedian(live_share(counts, fit), axis=1)
        seconds, error = _pooled(fit)
        spread = max(self.spread)
        # events in excess of Poisson's widen it, too
        error *= float(np.sqrt(spread))
        found = DeadTimeEstimate(seconds, error, fit.kind, ratio > _CLEAR_KIND)
        return found, misfit(counts, fit, spread**2), live

    def nonlinearity(self) -> float:
        """Loss of bright light against a line through dim light and the dark, in its errors."""
        within = [at for at, used in enumerate(self.used) if used.mean() > 0.5]
        order = sorted(within, key=lambda at: self.levels[at].light_hz)
        lit = [at for at in order if self.levels[at].light_hz]
        if not lit:
            return 0.0
        low, dim, bright = order[0], lit[0], lit[-1]
        base, middle, top = (self.levels[at] for at in (low, dim, bright))
        if middle.light_hz in (base.light_hz, top.light_hz):
            return 0.0
        good = self.used[low] & self.used[dim] & self.used[bright]
        slope = (top.light_hz - base.light_hz) / (middle.light_hz - base.light_hz)
        shares = (1 - slope, slope, -1.0)
        rates = [self.rates(at, self.levels[at].mean) for at in (low, dim, bright)]
        lost = sum(share * rate[good] for share, rate in zip(shares, rates, strict=True))
        variance = sum(
            share**2 * self._variance(at, rate)[good]
            for share, at, rate in zip(shares, (low, dim, bright), rates, strict=True)
        )
        return float(np.sum(lost) / np.sqrt(np.sum(variance))) if good.any() else 0.0

    def rates(self, at: int, counts: Floats, later: float = 0.0) -> Floats:
        """Rate of arrivals (Hz) behind mean readings, for a dead time so many errors longer."""
        exposure_s = self.levels[at].exposure_s
        if self.is_binary:
            return np.asarray(-np.log1p(-np.minimum(counts, 1 - 1e-12)) / exposure_s)
        if self.applied is None:
            return np.asarray(counts / exposure_s)
        grid, mean, _ = self._law(exposure_s, later)
        # counts are those of arrivals at low rates, which the grid does not reach
        loss = np.interp(counts, mean, mean / (grid * exposure_s))
        return np.asarray(counts / loss / exposure_s)

    def _law(self, exposure_s: float, later: float = 0.0) -> tuple[Floats, Floats, Floats]:
        """Rates, and mean and variance of their counts."""
        assert self.applied is not None
        seconds = max(self.applied.seconds + later * self.applied.error, 1e-12)
        top = 0.95 if self.applied.kind == "paralyzable" else 50.0
        grid = np.geomspace(1e-3 / exposure_s, max(top / seconds, 1 / exposure_s), _GRID)
        own = np.full(grid.shape, seconds)
        mean, variance = dead_time_moments(grid, exposure_s, own, self.applied.kind)
        return grid, np.maximum.accumulate(mean), variance

    def dark_counts(self, refused: dict[str, str]) -> Estimate | None:
        """Dark counts from recordings in the dark, with exact intervals."""
        dark = [at for at, level in enumerate(self.levels) if not level.light_hz]
        if not dark:
            refused["dark counts"] = "need a recording in the dark"
            return None
        used = np.array([self.used[at] for at in dark])
        frames = np.array([self.levels[at].frames for at in dark])[:, None, None] * used
        total = (np.array([self.levels[at].total for at in dark]) * used).sum(axis=0)
        number = frames.sum(axis=0)
        times = np.array([self.levels[at].exposure_s for at in dark])
        ends = _binomial(total, number) if self.is_binary else garwood_interval(total)
        spread = np.sqrt(max(self.spread[at] for at in dark))
        value = _solved(total, frames, times, self.is_binary)
        scale = spread * (_narrower(value, frames, times) if self.is_binary else 1.0)
        low, high = (
            _solved(total + scale * (end - total), frames, times, self.is_binary) for end in ends
        )
        found = [np.where(number > 0, each, np.nan) for each in (value, low, high)]
        if self.applied is not None:
            # to first order, both kinds of dead time hide the same counts
            longer = 1 + found[0] * self.applied.seconds
            found = [each * longer for each in found]
        return Estimate(*found)

    def telegraph(self) -> Switching | None:
        """Switching pixels, from the recording in the dark with the most counts."""
        dark = [at for at, level in enumerate(self.levels) if not level.light_hz]
        pixels = np.zeros(self.shape, np.bool_)
        for at in dark:
            pixels |= self.levels[at].correlation.is_telegraph & self.used[at]
        if not pixels.any():
            return None
        best = max(dark, key=lambda at: float(self.levels[at].total[pixels].sum()))
        level = self.levels[best]
        low, high, frames = switching(level.mean, level.variance, level.correlation, pixels)
        low_hz, high_hz = (self.rates(best, each) for each in (low, high))
        low_hz = np.maximum(low_hz, high_hz / _LARGEST_STEP)
        return Switching(pixels, low_hz, high_hz, frames * level.exposure_s)

    def efficiency(self, refused: dict[str, str]) -> Estimate | None:
        """Slope of rates over light, by weighted least squares."""
        lights = {level.light_hz for level in self.levels}
        if len(lights) < 2:
            wanted = (
                "the dark or a second light" if max(lights) else "a recording under uniform light"
            )
            refused["efficiency"] = f"needs {wanted}"
            return None
        if abs(self.nonlinearity()) > _NOT_LINEAR:
            refused["efficiency"] = (
                "rates are not proportional to light; check the lights, or record dimmer and "
                "brighter ones, so that dead time is found"
            )
            return None
        used = np.array(self.used, np.float64)
        light = np.array([each.light_hz for each in self.levels])
        rate = np.array([self.rates(at, each.mean) for at, each in enumerate(self.levels)])
        fitted, solution, covariance = rate, np.zeros((2, *self.shape)), np.zeros((3, *self.shape))
        for _ in range(_ROUNDS):
            weight = used / np.array([self._variance(at, each) for at, each in enumerate(fitted)])
            solution, covariance = _line(light / light.max(), rate, weight)
            fitted = np.maximum(solution[0] + solution[1] * (light / light.max())[:, None, None], 0)
        slope, error = solution[1] / light.max(), np.sqrt(covariance[2]) / light.max()
        if self.applied is not None and self.applied.error:
            moved = [self.rates(at, each.mean, 1.0) for at, each in enumerate(self.levels)]
            other = _line(light / light.max(), np.array(moved), weight)[0][1] / light.max()
            error = np.hypot(error, other - slope)
        several = np.array([used[light == each].max(axis=0) for each in sorted(lights)]).sum(axis=0)
        error = np.where((several > 1) & (error > 0), error, np.nan)
        rows, columns = self.shape
        return Estimate.normal(slope, error, (rows, columns))

    def _variance(self, at: int, rate: Floats) -> Floats:
        """Variance of the estimated rate of a level, Hz², at this rate."""
        level = self.levels[at]
        arrivals = np.maximum(rate * level.exposure_s, 0.3 / level.frames)
        if self.is_binary:
            return np.asarray(np.expm1(arrivals) / level.frames / level.exposure_s**2)
        if self.applied is None:
            return np.asarray(self.spread[at] * arrivals / level.frames / level.exposure_s**2)
        grid, mean, variance = self._law(level.exposure_s)
        slope = np.interp(rate, grid, np.maximum(np.gradient(mean, grid), 1e-12))
        own = np.where(rate < grid[0], arrivals, np.interp(rate, grid, variance))
        return np.asarray(self.spread[at] * own / level.frames / slope**2)


def _pooled(fit: SaturationFit) -> tuple[float, float]:
    """Dead time of all pixels, and its standard error."""
    seconds, error = fit.solution[:, 2], np.sqrt(np.maximum(fit.covariance[:, 2, 2], 0))
    known = (error > 0) & np.isfinite(error) & np.isfinite(seconds)
    own = float(np.median(error[known]))
    whole = own / np.sqrt(known.sum())
    if np.median(seconds[known]) > _SURE * own:
        return float(seconds[known].mean()), float(whole)
    # fits end at 0, which moves the mean, but not the median
    return float(np.median(seconds[known])), float(_OF_MEDIAN * whole)


def _binomial(total: Floats, number: Floats) -> tuple[Floats, Floats]:
    """Sums between which those of binomial numbers lie with 95 %: Clopper and Pearson (1934)."""
    number = np.maximum(number, 1)
    low = beta.ppf(0.025, np.maximum(total, 1e-9), number - total + 1)
    high = beta.isf(0.025, total + 1, np.maximum(number - total, 1e-9))
    return np.where(total > 0, low, 0.0) * number, np.where(total < number, high, 1.0) * number


def _solved(total: Floats, frames: Floats, times: Floats, is_binary: bool) -> Floats:
    """Rate at which the expected sum of all frames (levels, rows, columns) is the total, Hz."""
    live = (frames * times[:, None, None]).sum(axis=0)
    rate = np.maximum(total, 0) / np.maximum(live, 1e-300)
    if not is_binary:
        return np.asarray(rate)
    for _ in range(40):
        left = frames * np.exp(-rate * times[:, None, None])
        excess = total - (frames - left).sum(axis=0)
        slope = np.maximum((left * times[:, None, None]).sum(axis=0), 1e-12 * live + 1e-300)
        rate = np.clip(rate + excess / slope, 0, 60 / times.min())
    return np.asarray(rate)


def _narrower(rate: Floats, frames: Floats, times: Floats) -> Floats:
    """σ of a sum of unequal binomial numbers over that of one with their mean probability."""
    p = -np.expm1(-rate * times[:, None, None])
    number = np.maximum(frames.sum(axis=0), 1)
    mean = (frames * p).sum(axis=0) / number
    one, several = number * mean * (1 - mean), (frames * p * (1 - p)).sum(axis=0)
    return np.asarray(np.sqrt(np.divide(several, one, out=np.ones_like(one), where=one > 0)))


def _line(light: Floats, rate: Floats, weight: Floats) -> tuple[Floats, Floats]:
    """Intercept and slope (2, …) of rates over light, and their covariance (3, …): 00, 01, 11."""
    x = light[:, None, None]
    s, sx, sxx = weight.sum(axis=0), (weight * x).sum(axis=0), (weight * x * x).sum(axis=0)
    sy, sxy = (weight * rate).sum(axis=0), (weight * x * rate).sum(axis=0)
    det = s * sxx - sx**2
    det = np.where(det > 1e-12 * np.maximum(s * sxx, 1e-300), det, np.nan)
    solution = np.array([sxx * sy - sx * sxy, s * sxy - sx * sy]) / det
    return np.nan_to_num(solution), np.nan_to_num(np.array([sxx, -sx, s]) / det)
