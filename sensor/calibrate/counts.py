"""Device of a counting or binary camera, from recordings in the dark and under uniform light.

Arrivals of rate r = d + η·φ, with d dark counts, η the efficiency and φ the light, make mean counts
M(r), without dead time r·T. Of binary frames a share p = 1 − exp(−r·T) is 1, whatever the dead
time; so r = −ln(1 − p)/T, with the variance p/((1 − p)·n)/T² of n frames.

    dark counts    exact intervals of Poisson or binomial sums (Garwood 1936; Clopper and Pearson
                   1934), through the inverse of M
    dead time      saturation curve (`saturation`) of 2048 pixels at most
    efficiency     weighted line through rates over light

Variance beyond that of independent events (afterpulses, crosstalk), by its mean over the array,
widens intervals. Crosstalk and afterpulses, p per avalanche, make arrivals a = r + p·m from m
counted avalanches per second, fewer of which come from busy pixels: lights are scaled to a, by
(1 − p)/(1 − p·m/a), before dead time is fitted. Pixels of a level are omitted where a counter was
at its capacity, or fewer than ten binary frames were 0.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta

from megalopta.core.arrays import Floats, Ints, Mask, mean_and_variance
from megalopta.core.quantities import with_error
from megalopta.sensor.calibrate import crosstalk, pixels, saturation
from megalopta.sensor.calibrate.device import Estimate, garwood_interval
from megalopta.sensor.calibrate.level import check_steadiness, conditions
from megalopta.sensor.effects.dead_time import DeadTime

_FEWEST_FRAMES = 50
_FEWEST_ZEROS = 10
_ROUNDS = 4


class Summed(NamedTuple):
    """Statistics of one recording of counts or bits, maps (rows, columns)."""

    exposure_s: float
    light_hz: float
    """Photons per second on a pixel, or any unit that all recordings share; 0: dark"""
    is_binary: bool
    frames: int
    total: Floats
    """Sum of all frames"""
    variance: Floats
    largest: Floats
    at_largest: Floats
    """Number of frames at the pixel's own largest reading"""
    correlation: pixels.Correlation
    kernel: crosstalk.Kernel | None
    """Crosstalk and afterpulses by coincidences, of counts in the dark that determine them"""

    @property
    def mean(self) -> Floats:
        """Mean reading."""
        return self.total / self.frames

    def __str__(self) -> str:
        return conditions(self.light_hz, self.exposure_s)


def summed(
    readings: NDArray[Any], exposure_s: float, light_hz: float, *, is_binary: bool
) -> Summed:
    """Sum up a recording: counts, or bits as 0 and 1, (n, rows, columns).

    Frames are read one by one: a copy of all as numbers would take eight times the memory of bits.
    Raises ValueError if there are too few frames, or readings drift.
    """
    n = len(readings)
    if readings.ndim != 3 or n < _FEWEST_FRAMES:
        raise ValueError(f"{n} frames; capture {_FEWEST_FRAMES} or more")
    mean, variance = mean_and_variance(readings)
    largest, at_largest = readings.max(axis=0), np.zeros(mean.shape)
    for frame in readings:
        at_largest += frame == largest
    correlation = pixels.correlation(readings, np.ones(mean.shape, np.bool_))
    kernel = None
    if not is_binary and not light_hz:
        # coincidences are sought in 256 MiB of numbers
        frames = max(2**25 // mean.size, _FEWEST_FRAMES)
        varies = (variance > 0) & ~correlation.is_telegraph
        with suppress(ValueError):  # too few pixels have neighbors
            kernel = crosstalk.neighbor_kernel(readings[:frames], varies)
    recording = Summed(
        exposure_s, light_hz, is_binary, n, mean * n, variance, largest.astype(np.float64),
        at_largest, correlation, kernel,
    )  # fmt: skip
    check_steadiness(recording, readings.mean(axis=(1, 2), dtype=np.float64), variance)
    return recording


def summed_bits(sums: NDArray[Any], bits: int, exposure_s: float, light_hz: float) -> Summed:
    """Sum up a recording whose frames (n, rows, columns) are sums of so many binary frames each.

    Telegraph noise is not looked for. Drift is, in 50 frames or more.

    Raises ValueError if there are too few binary frames, readings exceed their number, or drift.
    """
    n = len(sums) * bits
    if n < _FEWEST_FRAMES:
        raise ValueError(f"{n} binary frames; capture {_FEWEST_FRAMES} or more")
    if sums.max() > bits:
        raise ValueError(f"a frame has {sums.max()} counts, more than sums: {bits} binary frames")
    total = sums.sum(axis=0, dtype=np.float64)
    share, is_seen = total / n, total > 0
    variance = share * (1 - share) * n / (n - 1)
    recording = Summed(
        exposure_s, light_hz, True, n, total, variance, is_seen.astype(np.float64),
        np.where(is_seen, total, n), pixels.uncorrelated(total.shape, n), None,
    )  # fmt: skip
    if len(sums) >= _FEWEST_FRAMES:
        check_steadiness(recording, sums.mean(axis=(1, 2), dtype=np.float64) / bits, variance)
    return recording


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
    kind: saturation.DeadTimeKind
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
    kernel: crosstalk.Kernel | None
    """Crosstalk and afterpulses by coincidences of dark counts"""
    saturated: Mask
    """Usable in no recording"""
    hot: Mask
    refused: Mapping[str, str]
    """Why an estimate is missing, by its name"""

    @property
    def bad(self) -> Mask:
        """Pixels that show no light."""
        return self.dead | self.stuck | self.saturated


class _Recorded(NamedTuple):
    """Recordings as all estimators use them, (levels,) or maps (levels, rows, columns)."""

    total: Floats
    frames: Floats
    exposure_s: Floats
    light_hz: Floats
    used: Mask
    """Pixels whose readings determine rates"""
    spread: Floats
    """Variance over that of independent events"""
    is_binary: bool

    @property
    def mean(self) -> Floats:
        """Mean readings."""
        return self.total / self.frames[:, None, None]


def calibrate_counts(recordings: Sequence[Summed], known: DeadTime | None = None) -> CountingDevice:
    """Estimate what the recordings determine, with 95 % CI.

    Parameters
    ----------
    recordings : sequence of Summed
        Recordings of one camera.
    known : DeadTime, optional
        Dead time that corrects counts if recordings do not determine it.

    Raises ValueError if recordings are of different arrays, or light has no effect.
    """
    _check(recordings)
    recorded, dead, stuck, capacity = _usable(recordings)
    kernels = [recording.kernel for recording in recordings if recording.kernel is not None]
    kernel = crosstalk.mean_kernel(kernels) if kernels else None
    dead_time: DeadTimeEstimate | None = None
    if not isinstance(fitted := _dead_time(recorded, kernel), str):
        dead_time, light_hz = fitted
        recorded = recorded._replace(light_hz=light_hz)
    applied = dead_time
    if not (dead_time or recorded.is_binary or known is None or known.kind == "ideal"):
        applied = DeadTimeEstimate(known.dead_time_s, 0.0, known.kind, True)
    dark, efficiency = _dark_counts(recorded, applied), _efficiency(recorded, applied)
    telegraph = _telegraph(recordings, recorded, applied)
    hot = np.zeros(dead.shape, np.bool_)
    if isinstance(dark, Estimate):
        hot = pixels.hot_pixels(dark.low, dark.value, dark.high)
        hot |= np.isnan(dark.value)  # saturated in the dark
    if isinstance(efficiency, Estimate) and telegraph is not None:
        # how many of their counts under light were dark ones is not known
        efficiency = efficiency.where(~telegraph.pixels)
    estimates = {"dead time": fitted, "dark counts": dark, "efficiency": efficiency}
    return CountingDevice(
        dark_counts_hz=dark if isinstance(dark, Estimate) else None,
        efficiency=efficiency if isinstance(efficiency, Estimate) else None,
        dead_time=dead_time, capacity=capacity,
        dead=dead, stuck=stuck, telegraph=telegraph, kernel=kernel,
        reading=np.where(stuck, recordings[0].largest, np.where(dead, 0.0, -1.0)),
        saturated=~recorded.used.any(axis=0) & ~dead & ~stuck, hot=hot & ~dead & ~stuck,
        refused={name: reason for name, reason in estimates.items() if isinstance(reason, str)},
    )  # fmt: skip


def _usable(recordings: Sequence[Summed]) -> tuple[_Recorded, Mask, Mask, int | None]:
    """Readings that determine rates, dead and stuck pixels, and the capacity of the counter."""
    is_binary = recordings[0].is_binary
    total, largest, at_largest = (
        np.array([getattr(recording, name) for recording in recordings])
        for name in ("total", "largest", "at_largest")
    )
    frames, exposure_s, light_hz = np.array(
        [(recording.frames, recording.exposure_s, recording.light_hz) for recording in recordings]
    ).T
    # share of frames at the largest reading of the pixel
    share = at_largest / frames[:, None, None]
    # pixels that show no light
    counts = total[light_hz > 0 if light_hz.any() else light_hz == 0].sum(axis=0)
    typical = float(np.median(counts))
    frozen = ((share == 1) & (largest == largest[0])).all(axis=0)
    dead = pixels.dead_pixels(counts, np.full(counts.shape, typical))
    dead |= frozen & (counts == 0) & (typical > _FEWEST_ZEROS)
    stuck = frozen & ~dead & (counts > 0)
    # the counter's capacity: the largest reading, if pixels pile up there while readings vary
    capacity: int | None = 1
    within = frames[:, None, None] - total >= _FEWEST_ZEROS
    if not is_binary:
        top = largest.max()
        piled = ((largest == top) & (share > 0.5)).mean(axis=(1, 2))
        several = (piled > 0).sum() > 1 or piled.max() > 2 / counts.size
        capacity = int(top) if top > 1 and several else None
        within = largest < (capacity or np.inf)
    used = within & ~dead & ~stuck
    spread = np.array([_excess(*pair) for pair in zip(recordings, used, strict=True)])
    recorded = _Recorded(total, frames, exposure_s, light_hz, used, spread, is_binary)
    return recorded, dead, stuck, capacity


def _check(recordings: Sequence[Summed]) -> None:
    shapes = sorted({recording.total.shape for recording in recordings})
    if len(shapes) != 1:
        raise ValueError(f"recordings of {shapes} pixels; give frames of one device")
    if len({recording.is_binary for recording in recordings}) > 1:
        raise ValueError("recordings of counts and of bits; give frames of one kind")
    dark = [recording for recording in recordings if not recording.light_hz]
    if not dark:
        return
    longest = max(dark, key=lambda recording: recording.exposure_s)
    dark_counts = float(np.median(longest.mean))
    if longest.is_binary and dark_counts > 0.9:
        return
    for recording in recordings:
        share = recording.exposure_s / longest.exposure_s
        excess = float(np.median(recording.mean)) - dark_counts * share
        error = float(np.sqrt(recording.variance.mean() / recording.frames / recording.total.size))
        if recording.light_hz and excess < 6.0 * error:
            raise ValueError(
                f"{recording}: no brighter than the dark; uncover the sensor or raise the light"
            )


def _excess(recording: Summed, used: Mask) -> float:
    """Variance over that of independent events, by the mean of the array; at least 1."""
    if recording.is_binary or not used.any():
        return 1.0
    ratio = float(recording.variance[used].sum() / max(recording.mean[used].sum(), 1e-300))
    error = float(
        np.sqrt(2 / recording.frames / used.sum() + 1 / max(recording.total[used].sum(), 1))
    )
    return ratio if ratio > 1 + 3 * error else 1.0


def _dead_time(
    recorded: _Recorded, kernel: crosstalk.Kernel | None
) -> tuple[DeadTimeEstimate, Floats] | str:
    """Dead time from the saturation curve, and lights scaled to all arrivals; or why not."""
    if recorded.is_binary:
        return "bits do not show it; give that of the data sheet"
    lit = recorded.light_hz > 0
    good = np.flatnonzero(recorded.used[lit].sum(axis=0) > 1)
    if len(np.unique(recorded.light_hz[lit])) < 2 or not good.size:
        return "needs counts under two lights, the brighter of which loses some to it"
    if _nonlinearity(recorded, None) < 5.0:
        return "no counts are lost to it; record brighter light"
    fitted = good[np.linspace(0, good.size - 1, min(good.size, 2048)).astype(int)]
    fired, fired_error = kernel.echoes if kernel else (0.0, 0.0)
    rounds = _ROUNDS if fired else 1
    dead_time, misfit, live = _fitted_dead_time(recorded, fitted, fired, 1.0, rounds)
    if misfit.is_clear:
        return (
            f"{dead_time.kind}, {with_error(dead_time.seconds, 0, 's')}, fits best, but counts "
            f"differ from its curve by {100 * misfit.share:+.2g} %, as with recharging, twilight "
            "pulses, or lights that are not as stated; no interval holds"
        )
    if kernel:
        # how many afterpulses the dead time hides depends on their delay, which frames do not show
        longer = _fitted_dead_time(recorded, fitted, fired + fired_error, live, 1)[0]
        # half of those lost in it, of a delay not shorter than it, extend a paralyzable one
        hidden = 0.36 * (kernel.afterpulses + fired_error) * dead_time.seconds
        error = np.hypot(longer.seconds - dead_time.seconds, max(hidden, 0.0))
        dead_time = dead_time._replace(
            error=float(np.hypot(dead_time.error, error)),
            is_kind_clear=dead_time.is_kind_clear and longer.kind == dead_time.kind,
        )
    return dead_time, recorded.light_hz * (1 - fired) / (1 - fired * live)


def _fitted_dead_time(
    recorded: _Recorded, fitted: Ints, fired: float, live: Floats | float, rounds: int
) -> tuple[DeadTimeEstimate, saturation.Misfit, Floats]:
    """Dead time of some pixels, its misfit, and the shares of arrivals counted at each level.

    Lights are scaled for so many `fired` events per avalanche, with these shares at first.
    """
    levels = len(recorded.frames)
    mean = recorded.mean.reshape(levels, -1)[:, fitted]
    frames = recorded.used.reshape(levels, -1)[:, fitted] * recorded.frames[:, None]
    for _ in range(rounds):
        light_hz = recorded.light_hz * (1 - fired) / (1 - fired * live)
        counts = saturation.MeanCounts(mean, frames, recorded.exposure_s, light_hz)
        fit, ratio = saturation.fit_saturation(counts, lambda fits: _pooled(fits)[0])
        live = np.nanmedian(saturation.live_share(counts, fit), axis=1)
    seconds, error = _pooled(fit)
    # events in excess of Poisson's widen the interval, too
    spread = float(recorded.spread.max())
    error *= float(np.sqrt(spread))
    dead_time = DeadTimeEstimate(seconds, error, fit.kind, ratio > 6.0)
    return dead_time, saturation.misfit(counts, fit, spread**2), np.asarray(live)


def _pooled(fit: saturation.SaturationFit) -> tuple[float, float]:
    """Dead time of all pixels, and its standard error."""
    seconds, error = fit.solution[:, 2], np.sqrt(np.maximum(fit.covariance[:, 2, 2], 0))
    known = (error > 0) & np.isfinite(error) & np.isfinite(seconds)
    of_pixel = float(np.median(error[known]))
    of_array = of_pixel / np.sqrt(known.sum())
    if np.median(seconds[known]) > 4.0 * of_pixel:
        return float(seconds[known].mean()), float(of_array)
    # fits end at 0, which moves the mean, but not the median
    return float(np.median(seconds[known])), float(1.2533 * of_array)


def _nonlinearity(recorded: _Recorded, dead_time: DeadTimeEstimate | None) -> float:
    """Loss of bright light against a line through dim light and the dark, in its errors."""
    light_hz = recorded.light_hz
    within = np.flatnonzero(recorded.used.mean(axis=(1, 2)) > 0.5)
    order = within[np.argsort(light_hz[within], kind="stable")]
    lit = order[light_hz[order] > 0]
    if not lit.size:
        return 0.0
    levels = int(order[0]), int(lit[0]), int(lit[-1])
    low, dim, bright = (float(light_hz[level]) for level in levels)
    if dim in (low, bright):
        return 0.0
    good = recorded.used[list(levels)].all(axis=0)
    slope = (bright - low) / (dim - low)
    loss, variance = np.zeros(good.sum()), np.zeros(good.sum())
    for level, share in zip(levels, (1 - slope, slope, -1.0), strict=True):
        rate_hz = _rates(recorded, level, recorded.mean[level], dead_time)
        loss = loss + share * rate_hz[good]
        variance = variance + share**2 * _variance(recorded, level, rate_hz, dead_time)[good]
    return float(np.sum(loss) / np.sqrt(np.sum(variance))) if good.any() else 0.0


def _rates(
    recorded: _Recorded, level: int, counts: Floats, dead_time: DeadTimeEstimate | None,
    errors: float = 0.0,
) -> Floats:  # fmt: skip
    """Rate of arrivals (Hz) behind mean readings, for a dead time so many errors longer."""
    exposure_s = recorded.exposure_s[level]
    if recorded.is_binary:
        return np.asarray(-np.log1p(-np.minimum(counts, 1 - 1e-12)) / exposure_s)
    if dead_time is None:
        return np.asarray(counts / exposure_s)
    grid_hz, mean, _ = _counted(dead_time, exposure_s, errors)
    # counts are those of arrivals at low rates, which the grid does not reach
    live = np.interp(counts, mean, mean / (grid_hz * exposure_s))
    return np.asarray(counts / live / exposure_s)


def _variance(
    recorded: _Recorded, level: int, rate_hz: Floats, dead_time: DeadTimeEstimate | None
) -> Floats:
    """Variance of the estimated rate of a level, Hz², at this rate."""
    exposure_s, frames = recorded.exposure_s[level], recorded.frames[level]
    arrivals = np.maximum(rate_hz * exposure_s, 0.3 / frames)
    if recorded.is_binary:
        return np.asarray(np.expm1(arrivals) / frames / exposure_s**2)
    of_counts, slope = arrivals, np.full(rate_hz.shape, exposure_s)
    if dead_time is not None:
        grid_hz, mean, variance = _counted(dead_time, exposure_s)
        slope = np.interp(rate_hz, grid_hz, np.maximum(np.gradient(mean, grid_hz), 1e-12))
        of_counts = np.where(rate_hz < grid_hz[0], arrivals, np.interp(rate_hz, grid_hz, variance))
    return np.asarray(recorded.spread[level] * of_counts / frames / slope**2)


def _counted(
    dead_time: DeadTimeEstimate, exposure_s: float, errors: float = 0.0
) -> tuple[Floats, Floats, Floats]:
    """Rates, and mean and variance of their counts, for a dead time so many errors longer."""
    seconds = max(dead_time.seconds + errors * dead_time.error, 1e-12)
    most = 0.95 if dead_time.kind == "paralyzable" else 50.0
    grid_hz = np.geomspace(1e-3 / exposure_s, max(most / seconds, 1 / exposure_s), 4000)
    dead_s = np.full(grid_hz.shape, seconds)
    mean, variance = saturation.dead_time_moments(grid_hz, exposure_s, dead_s, dead_time.kind)
    return grid_hz, np.maximum.accumulate(mean), variance


def _dark_counts(recorded: _Recorded, dead_time: DeadTimeEstimate | None) -> Estimate | str:
    """Dark counts from recordings in the dark, with exact intervals, or why not."""
    is_dark = recorded.light_hz == 0
    if not is_dark.any():
        return "need a recording in the dark"
    used, times_s = recorded.used[is_dark], recorded.exposure_s[is_dark, None, None]
    frames = recorded.frames[is_dark, None, None] * used
    total, number = (recorded.total[is_dark] * used).sum(axis=0), frames.sum(axis=0)
    live_s = (frames * times_s).sum(axis=0)

    def rate_of(total: Floats) -> Floats:
        """Rate (Hz) at which the expected sum of all frames is the total."""
        rate_hz = np.maximum(total, 0) / np.maximum(live_s, 1e-300)
        for _ in range(40 if recorded.is_binary else 0):  # Newton's method
            zeros = frames * np.exp(-rate_hz * times_s)
            excess = total - (frames - zeros).sum(axis=0)
            slope = np.maximum((zeros * times_s).sum(axis=0), 1e-12 * live_s + 1e-300)
            rate_hz = np.clip(rate_hz + excess / slope, 0, 60 / times_s.min())
        return np.asarray(rate_hz)

    value, ends = rate_of(total), garwood_interval(total)
    scale = np.sqrt(recorded.spread[is_dark].max()) * np.ones(total.shape)
    if recorded.is_binary:  # Clopper and Pearson
        several = np.maximum(number, 1)
        low = beta.ppf(0.025, np.maximum(total, 1e-9), several - total + 1)
        high = beta.isf(0.025, total + 1, np.maximum(several - total, 1e-9))
        low, high = np.where(total > 0, low, 0.0), np.where(total < several, high, 1.0)
        ends = low * several, high * several
        # σ of a sum of unequal binomial numbers over that of one with their mean probability
        p = -np.expm1(-value * times_s)
        share = (frames * p).sum(axis=0) / several
        alike, unequal = number * share * (1 - share), (frames * p * (1 - p)).sum(axis=0)
        scale *= np.sqrt(np.divide(unequal, alike, out=np.ones_like(alike), where=alike > 0))
    low, high = (rate_of(total + scale * (end - total)) for end in ends)
    # to first order, both kinds of dead time hide the same counts
    hidden = 1 + value * (dead_time.seconds if dead_time else 0.0)
    return Estimate(value, low, high).where(number > 0).scaled(hidden)


def _telegraph(
    recordings: Sequence[Summed], recorded: _Recorded, dead_time: DeadTimeEstimate | None
) -> Switching | None:
    """Switching pixels, from the recording in the dark with the most counts."""
    dark = np.flatnonzero(recorded.light_hz == 0).tolist()
    marked = np.zeros(recorded.used.shape[1:], np.bool_)
    for number in dark:
        marked |= recordings[number].correlation.is_telegraph & recorded.used[number]
    if not marked.any():
        return None
    best = max(dark, key=lambda number: float(recordings[number].total[marked].sum()))
    recording = recordings[best]
    *means, frames = pixels.switching(
        recording.mean, recording.variance, recording.correlation, marked
    )
    low_hz, high_hz = (_rates(recorded, best, mean, dead_time) for mean in means)
    # the largest ratio that data can distinguish from an infinite one
    low_hz = np.maximum(low_hz, high_hz / 50.0)
    return Switching(marked, low_hz, high_hz, frames * recording.exposure_s)


def _efficiency(recorded: _Recorded, dead_time: DeadTimeEstimate | None) -> Estimate | str:
    """Slope of rates over light, by weighted least squares, or why not."""
    lights = np.unique(recorded.light_hz)
    if len(lights) < 2:
        need = "the dark or a second light" if lights.max() else "a recording under uniform light"
        return f"needs {need}"
    if abs(_nonlinearity(recorded, dead_time)) > 8.0:
        return (
            "rates are not proportional to light; check the lights, or record dimmer and brighter "
            "ones, so that dead time is found"
        )
    used, brightest = recorded.used.astype(np.float64), lights.max()
    light = (recorded.light_hz / brightest)[:, None, None]

    def rates(errors: float) -> Floats:
        levels = enumerate(recorded.mean)
        return np.array([_rates(recorded, at, mean, dead_time, errors) for at, mean in levels])

    rate_hz = fitted_hz = rates(0.0)
    for _ in range(_ROUNDS):
        variance = [_variance(recorded, at, rate, dead_time) for at, rate in enumerate(fitted_hz)]
        weight = used / np.array(variance)
        intercept, slope, slope_variance = _line(light, rate_hz, weight)
        fitted_hz = np.maximum(intercept + slope * light, 0)
    value, error = slope / brightest, np.sqrt(slope_variance) / brightest
    if dead_time is not None and dead_time.error:
        moved = _line(light, rates(1.0), weight)[1] / brightest
        error = np.hypot(error, moved - value)
    several = np.sum([used[recorded.light_hz == hz].max(axis=0) for hz in lights], axis=0)
    error = np.where((several > 1) & (error > 0), error, np.nan)
    return Estimate.normal(value, error, (used.shape[1], used.shape[2]))


def _line(light: Floats, rate: Floats, weight: Floats) -> tuple[Floats, Floats, Floats]:
    """Intercept and slope of rates over light (levels, 1, 1), and the variance of the slope."""
    s, sx, sxx, sy, sxy = (
        (weight * values).sum(axis=0)
        for values in (np.ones_like(light), light, light**2, rate, light * rate)
    )
    det = s * sxx - sx**2
    det = np.where(det > 1e-12 * np.maximum(s * sxx, 1e-300), det, np.nan)
    intercept, slope, variance = (sxx * sy - sx * sxy) / det, (s * sxy - sx * sy) / det, s / det
    return np.nan_to_num(intercept), np.nan_to_num(slope), np.nan_to_num(variance)
