"""Device of a counting or binary camera, from recordings in the dark and under uniform light.

Arrivals of rate r = d + η·φ, with d dark counts, η the efficiency and φ the light, make mean counts
M(r), without dead time r·T. Of binary frames a share p = 1 − exp(−r·T) is 1, whatever the dead
time; so r = −ln(1 − p)/T, with the variance p/((1 − p)·n)/T² of n frames.

    dark counts    exact intervals of Poisson or binomial sums (Garwood 1936; Clopper and Pearson
                   1934), through the inverse of M
    dead time      mean and variance over light and exposure (`recovery`), 2048 pixels at most
    efficiency     weighted line through rates over light

Variance beyond that of independent events (afterpulses, crosstalk), by its mean over the array,
widens intervals. Rates include afterpulses and crosstalk. Crosstalk, k per avalanche, makes
arrivals a = r + k·m from m counted avalanches per second, fewer of which come from busy pixels:
lights are scaled to a, by (1 − k)/(1 − k·m/a). Of every curve the goodness of fit is tested, by
residuals over all pixels. Pixels of a level are omitted where a counter was at its capacity, or
fewer than ten binary frames were 0.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta, chi2

from megalopta.core.arrays import Floats, Mask
from megalopta.core.errors import UserError
from megalopta.core.quantities import percent, with_error
from megalopta.sensor.calibrate import crosstalk, pixels
from megalopta.sensor.calibrate.level import check_steadiness, conditions
from megalopta.sensor.calibrate.misfit import Misfit, pooled_misfit
from megalopta.sensor.calibrate.pixels import Estimate, Quantity
from megalopta.sensor.calibrate.recovery import Curves, DeadTimeEstimate, Recovery, fit_recovery
from megalopta.sensor.calibrate.statistics import Statistics, statistics
from megalopta.sensor.effects.crosstalk import Crosstalk
from megalopta.sensor.effects.dead_time import DeadTime

Talk = tuple[Crosstalk, float]
"""Crosstalk, and the error of its mean"""
_FEWEST_FRAMES = 50
_FEWEST_ZEROS = 10


class Summed(NamedTuple):
    """Statistics of one recording of counts or bits."""

    exposure_s: float
    light_hz: float
    """Photons per second on a pixel, or any unit that all recordings share; 0: dark"""
    is_binary: bool
    of: Statistics
    is_known: Mask | bool = True
    """Pixels (rows, columns) whose counts are known"""
    name: str = ""
    """Name in messages, such as its file's"""

    def __str__(self) -> str:
        return self.name or conditions(self.light_hz, self.exposure_s)


def summed(
    readings: NDArray[Any], exposure_s: float, light_hz: float = 0.0, *, is_binary: bool = False
) -> Summed:
    """Sum up a recording: counts, or bits as 0 and 1, (n, rows, columns).

    `light_hz` is photons per second on a pixel, or any unit that all recordings share; 0: dark.
    Raises ValueError if there are too few frames, or readings drift.
    """
    n = len(readings)
    if readings.ndim != 3 or n < _FEWEST_FRAMES:
        raise ValueError(f"{n} frames; capture {_FEWEST_FRAMES} or more")
    recording = Summed(exposure_s, light_hz, is_binary, statistics(readings))
    check_steadiness(recording, recording.of.of_rows.mean(axis=1), recording.of.variance)
    return recording


def summed_bits(sums: NDArray[Any], bits: int, exposure_s: float, light_hz: float = 0.0) -> Summed:
    """Sum up a recording whose frames (n, rows, columns) are sums of so many binary frames each.

    The exposure is that of one binary frame, and the light as of `summed`.

    Telegraph noise is not looked for. Drift is, in 50 frames or more.

    Raises ValueError if there are too few binary frames, readings exceed their number, or drift.
    """
    n = len(sums) * bits
    if n < _FEWEST_FRAMES:
        raise ValueError(f"{n} binary frames; capture {_FEWEST_FRAMES} or more")
    if sums.max() > bits:
        raise ValueError(f"a frame has {sums.max()} counts, more than sums: {bits} binary frames")
    total, of_rows = sums.sum(axis=0, dtype=np.float64), sums.mean(axis=2, dtype=np.float64) / bits
    share, unknown = total / n, np.zeros((6, *total.shape))
    of = Statistics(
        n, share, share * (1 - share) * n / (n - 1), unknown[0], np.minimum(total, 1),
        np.where(total > 0, total, n), unknown, unknown, of_rows,
    )  # fmt: skip
    recording = Summed(exposure_s, light_hz, True, of)
    if len(sums) >= _FEWEST_FRAMES:
        check_steadiness(recording, of_rows.mean(axis=1), of.variance)
    return recording


class Switching(NamedTuple):
    """Pixels whose dark counts switch between two rates (rows, columns)."""

    pixels: Mask
    low_hz: Floats
    high_hz: Floats
    time_s: float
    """Correlation time"""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
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
    fits: Mapping[str, Misfit]
    """Goodness of fit of the curves behind estimates, by their names"""
    recordings: Sequence[Summed]
    """Data behind the estimates"""

    @property
    def bad(self) -> Mask:
        """Pixels that show no light."""
        return self.dead | self.stuck | self.saturated

    @property
    def quantities(self) -> list[Quantity]:
        """Estimates of every pixel."""
        known = ("dark counts", "Hz", self.dark_counts_hz), ("efficiency", "", self.efficiency)
        return [Quantity(name, unit, estimate) for name, unit, estimate in known if estimate]

    @property
    def sentence(self) -> str:
        """Sentence on the estimates, and on those that are missing."""
        return self.summary(self.quantities)

    def __repr__(self) -> str:
        return self.sentence

    def summary(
        self, quantities: Sequence[Quantity], talk: Talk | None = None, base: str = ""
    ) -> str:
        """Return the sentence on these quantities, crosstalk of hot pixels, and a preset's part."""
        text = ", ".join(map(str, quantities))
        text = f"{text[:1].upper()}{text[1:]} (medians of {self.bad.size} pixels ± 95 % CI of one)"
        text += f", dead time {self.dead_time}" if self.dead_time else ""
        if (kernel := self.kernel) is not None and kernel.seen:
            differs = " by direction or parity of lines" if kernel.crosstalk.kernel else ""
            text += f", crosstalk {crosstalk.text_of(kernel.seen)}{differs}"
        elif kernel is not None and not talk:
            text += f", crosstalk below {percent(kernel.limit)} per edge neighbor (95 %)"
        switching = f", {self.telegraph.pixels.sum()} telegraph" if self.telegraph else ""
        text += f". {self.bad.sum()} pixels are bad, {self.hot.sum()} hot{switching}."
        if self.refused:
            where = base and f", so the device file has those of {base}"
            text += f" Not known{where}: {'; '.join(map(': '.join, self.refused.items()))}."
        return text + "".join(
            f" {name.capitalize()}: {misfit}, so intervals do not hold."
            for name, misfit in self.fits.items()
            if misfit.is_clear and name not in self.refused
        )


class _Recorded(NamedTuple):
    """Recordings as all estimators use them, (levels,) or maps (levels, rows, columns)."""

    mean: Floats
    variance: Floats
    frames: Floats
    exposure_s: Floats
    light_hz: Floats
    used: Mask
    """Pixels whose readings determine rates"""
    known: Mask
    """Pixels (rows, columns) whose readings are known at some level"""
    spread: Floats
    """Variance over that of independent events"""
    is_binary: bool
    names: Sequence[str]

    @property
    def total(self) -> Floats:
        """Sums of all frames."""
        return self.mean * self.frames[:, None, None]


def calibrate_counts(recordings: Sequence[Summed], known: DeadTime | None = None) -> CountingDevice:
    """Estimate what the recordings of a camera determine, with 95 % CI.

    Raises ValueError if recordings are of different arrays, or light has no effect.

    Parameters
    ----------
    recordings
        `summed` counts or bits in the dark and under uniform light.
    known
        Dead time that corrects counts if recordings do not determine it.

    Returns
    -------
    CountingDevice
        Maps of dark counts and efficiency, dead time, crosstalk, bad pixels, and in `refused` why
        an estimate is missing. `megalopta spadcam calibrate` writes them as a device file.

    Examples
    --------
    >>> draw = np.random.default_rng(0).poisson
    >>> dark, lit = draw(3.0, (300, 8, 8)), draw(23.0, (300, 8, 8))
    >>> device = calibrate_counts([summed(dark, 1e-2), summed(lit, 1e-2, 1e4)])
    >>> round(device.dark_counts_hz.median), round(device.efficiency.median, 2)
    (300, 0.2)
    """
    _check(recordings)
    recorded, dead, stuck, capacity = _usable(recordings)
    correlations = {
        level: pixels.correlation(recordings[level].of, recorded.used[level])
        for level in np.flatnonzero(recorded.light_hz == 0).tolist()
    }
    kernels = []
    for level, correlation in correlations.items():
        good = recorded.used[level] & (recorded.variance[level] > 0) & ~correlation.is_telegraph
        with suppress(ValueError):  # too few pixels have neighbors
            recording, is_binary = recordings[level].of, recorded.is_binary
            kernels.append(crosstalk.neighbor_kernel(recording, good, is_binary=is_binary))
    kernel = crosstalk.mean_kernel(kernels) if kernels else None
    fits: dict[str, Misfit] = {}
    dead_time: DeadTimeEstimate | None = None
    recovery = None
    if not isinstance(fitted := _dead_time(recorded, kernel, fits), str):
        dead_time, light_hz = fitted
        recovery = dead_time.recovery
        recorded = recorded._replace(light_hz=light_hz)
        if kernel and recovery.fired:
            kernel = kernel._replace(
                afterpulses=recovery.fired, afterpulses_error=dead_time.fired_error
            )
    elif not (recorded.is_binary or known is None or known.kind == "ideal"):
        slow_s = known.recharge_s, known.twilight_s
        recovery = Recovery(known.kind, known.dead_time_s, 0.0, 1.0, *slow_s)
    dark = _dark_counts(recorded, recovery, fits)
    efficiency = _efficiency(recorded, recovery, dead_time, fits)
    telegraph = _telegraph(recorded, correlations, recovery)
    hot = np.zeros(dead.shape, np.bool_)
    if isinstance(dark, Estimate):
        hot = pixels.hot_pixels(dark.low, dark.value, dark.high)
        hot |= np.isnan(dark.value) & recorded.known  # saturated in the dark
    if isinstance(efficiency, Estimate) and telegraph is not None:
        # how many of their counts under light were dark ones is not known
        efficiency = efficiency.where(~telegraph.pixels)
    estimates = {"dead time": fitted, "dark counts": dark, "efficiency": efficiency}
    return CountingDevice(
        dark_counts_hz=dark if isinstance(dark, Estimate) else None,
        efficiency=efficiency if isinstance(efficiency, Estimate) else None,
        dead_time=dead_time, capacity=capacity,
        dead=dead, stuck=stuck, telegraph=telegraph, kernel=kernel,
        reading=np.where(stuck, recordings[0].of.largest, np.where(dead, 0.0, -1.0)),
        saturated=~recorded.used.any(axis=0) & ~dead & ~stuck, hot=hot & ~dead & ~stuck,
        refused={name: reason for name, reason in estimates.items() if isinstance(reason, str)},
        fits=fits, recordings=recordings,
    )  # fmt: skip


def _usable(recordings: Sequence[Summed]) -> tuple[_Recorded, Mask, Mask, int | None]:
    """Readings that determine rates, dead and stuck pixels, and the capacity of the counter."""
    is_binary, shape = recordings[0].is_binary, recordings[0].of.mean.shape
    is_known = np.array([np.broadcast_to(recording.is_known, shape) for recording in recordings])
    mean, variance, largest, at_largest = (
        np.array([getattr(recording.of, name) for recording in recordings])
        for name in ("mean", "variance", "largest", "at_largest")
    )
    frames, exposure_s, light_hz = np.array([(r.of.frames, *r[:2]) for r in recordings]).T
    total = mean * frames[:, None, None]
    # share of frames at the largest reading of the pixel
    share = at_largest / frames[:, None, None]
    # pixels that show no light
    counts = total[light_hz > 0 if light_hz.any() else light_hz == 0].sum(axis=0)
    typical = float(np.median(counts))
    frozen = ((share == 1) & (largest == largest[0])).all(axis=0)
    dead = pixels.dead_pixels(counts, np.full(counts.shape, typical))
    dead |= frozen & (counts == 0) & (typical > _FEWEST_ZEROS)
    known = np.asarray(is_known.any(axis=0))
    dead &= known
    stuck = frozen & ~dead & (counts > 0)
    # the counter's capacity: the largest reading, if pixels pile up there while readings vary
    capacity: int | None = 1
    within = frames[:, None, None] - total > _FEWEST_ZEROS - 0.5
    if not is_binary:
        top = largest.max(where=is_known, initial=0)
        piled = ((largest == top) & (share > 0.5)).mean(axis=(1, 2))
        several = (piled > 0).sum() > 1 or piled.max() > 2 / counts.size
        capacity = int(top) if top > 1 and several else None
        within = largest < (capacity or np.inf)
    used = within & is_known & ~dead & ~stuck
    # variance over that of independent events, by the mean of the array; at least 1
    total, number = np.maximum((mean * used).sum(axis=(1, 2)), 1e-300), used.sum(axis=(1, 2))
    fano = (variance * used).sum(axis=(1, 2)) / total
    error = np.sqrt((2 / np.maximum(number, 1) + 1 / np.maximum(total, 1 / frames)) / frames)
    spread = np.where((fano > 1 + 3 * error) & (not is_binary), fano, 1.0)
    recorded = _Recorded(
        mean,
        variance,
        frames,
        exposure_s,
        light_hz,
        used,
        known,
        spread,
        is_binary,
        [str(recording) for recording in recordings],
    )
    return recorded, dead, stuck, capacity


def _check(recordings: Sequence[Summed]) -> None:
    shapes = sorted({recording.of.mean.shape for recording in recordings})
    if len(shapes) != 1:
        raise ValueError(f"recordings of {shapes} pixels; give frames of one device")
    if len({recording.is_binary for recording in recordings}) > 1:
        raise ValueError("recordings of counts and of bits; give frames of one kind")
    dark = [recording for recording in recordings if not recording.light_hz]
    if not dark:
        return
    longest = max(dark, key=lambda recording: recording.exposure_s)
    dark_counts = float(np.median(longest.of.mean))
    if longest.is_binary and dark_counts > 0.9:
        return
    for recording in recordings:
        of, share = recording.of, recording.exposure_s / longest.exposure_s
        error = float(np.sqrt(of.variance.mean() / of.frames / of.mean.size))
        if recording.light_hz and np.median(of.mean) - dark_counts * share < 6.0 * error:
            raise ValueError(
                f"{recording}: no brighter than the dark; uncover the sensor or raise the light"
            )


def _dead_time(
    recorded: _Recorded, kernel: crosstalk.Kernel | None, fits: dict[str, Misfit]
) -> tuple[DeadTimeEstimate, Floats] | str:
    """Dead time, and lights scaled to all arrivals; or why not."""
    if recorded.is_binary:
        return "bits do not show it; write dead_time of the data sheet into the device file"
    levels, lit = len(recorded.frames), recorded.light_hz > 0
    used = recorded.used.reshape(levels, -1)
    good = np.flatnonzero(used[lit].sum(axis=0) > 1)
    if len(np.unique(recorded.light_hz[lit])) < 2 or not good.size:
        return "needs counts under two lights, the brighter of which loses some to it"
    if _nonlinearity(recorded) < 5.0:
        return "no counts are lost to it; record brighter light"
    # hot pixels, and those that hardly count, are no part of the curve
    counts = recorded.total.reshape(levels, -1)
    typical = np.median(counts[:, good], axis=1)
    near = np.abs(np.log(np.maximum(counts[:, good], 0.5) / typical[:, None])) < np.log(8)
    good = good[np.all(near | ~used[:, good], axis=0)]
    some = good[np.linspace(0, good.size - 1, min(good.size, 2048)).astype(int)]
    frames = recorded.used * recorded.frames[:, None, None]
    mean, variance, frames = (
        maps.reshape(levels, -1)[:, some] for maps in (recorded.mean, recorded.variance, frames)
    )
    talk = kernel.seen[0].mean_fired_neighbors if kernel and kernel.seen else 0.0
    talk_error = kernel.total_error if kernel else 0.0
    fired = kernel.afterpulses if kernel and kernel.are_afterpulses_seen else 0.0
    curves = Curves(mean, variance, frames, recorded.exposure_s, recorded.light_hz, talk)
    try:
        of = fit_recovery(curves, fired)
    except UserError:
        return "its curve takes too long to compute; record shorter exposures"
    recovery, fits["dead time"] = of.recovery, of.fit.misfit
    if of.fit.misfit.is_clear:
        return (
            f"{recovery.kind}, {with_error(recovery.dead_s, 0, 's')}, fits best, but counts differ "
            f"from its curve ({of.fit.misfit.summary(recorded.names)}), as with lights not as "
            "stated; no interval holds"
        )
    live = np.median(mean / of.fit.arrivals_hz, axis=1) / recorded.exposure_s
    live *= 1 - recovery.fired
    light_hz = recorded.light_hz * (1 - talk) / (1 - talk * live)
    # neighbors that busy pixels fire less look like a part of the dead time, and change no rates
    hidden_s = talk_error * recovery.dead_s
    return of._replace(error_s=float(np.hypot(of.error_s, hidden_s))), light_hz


def _nonlinearity(recorded: _Recorded) -> float:
    """Loss of bright light against a line through dim light and what is dimmer, in its errors."""
    light_hz = recorded.light_hz
    order = np.argsort(light_hz, kind="stable")
    order = order[recorded.used.mean(axis=(1, 2))[order] > 0.5]
    lit = order[light_hz[order] > light_hz[order[:1]]]
    if not lit.size or light_hz[lit[0]] == light_hz[lit[-1]]:
        return 0.0
    levels = [order[0], lit[0], lit[-1]]
    low, dim, bright = light_hz[levels]
    slope, good = (bright - low) / (dim - low), recorded.used[levels].all(axis=0)
    share = np.array([1 - slope, slope, -1.0]) / recorded.exposure_s[levels]
    counts, frames = recorded.mean[levels][:, good].sum(axis=1), recorded.frames[levels]
    variance = recorded.spread[levels] * np.maximum(counts, 0.3 / frames) / frames
    return float(share @ counts / np.sqrt(share**2 @ variance))


def _rates(recorded: _Recorded, level: int, counts: Floats, recovery: Recovery | None) -> Floats:
    """Rate of arrivals (Hz) behind mean readings."""
    exposure_s = recorded.exposure_s[level]
    if recorded.is_binary:
        return np.asarray(-np.log1p(-np.minimum(counts, 1 - 1e-12)) / exposure_s)
    if recovery is None:
        return np.asarray(counts / exposure_s)
    # of so many counts, and of those that a paralyzable dead time hides, too
    alive = 1 - min(float(counts.max()) * recovery.dead_s / exposure_s, 0.97)
    highest_hz = 3 * float(counts.max()) / alive / exposure_s
    grid_hz, mean, _ = _counted(recovery, exposure_s, highest_hz)
    # counts are those of arrivals at low rates, which the grid does not reach
    live = np.interp(counts, mean, mean / (grid_hz * exposure_s))
    return np.asarray(counts / live / exposure_s)


def _variance(
    recorded: _Recorded, level: int, rate_hz: Floats, recovery: Recovery | None
) -> Floats:
    """Variance of the estimated rate of a level, Hz², at this rate."""
    exposure_s, frames = recorded.exposure_s[level], recorded.frames[level]
    arrivals = np.maximum(rate_hz * exposure_s, 0.3 / frames)
    if recorded.is_binary:
        return np.asarray(np.expm1(arrivals) / frames / exposure_s**2)
    of_counts, slope = arrivals, np.full(rate_hz.shape, exposure_s)
    if recovery is not None:
        grid_hz, mean, variance = _counted(recovery, exposure_s, float(rate_hz.max()))
        slope = np.interp(rate_hz, grid_hz, np.maximum(np.gradient(mean, grid_hz), 1e-12))
        of_counts = np.where(rate_hz < grid_hz[0], arrivals, np.interp(rate_hz, grid_hz, variance))
    # afterpulses are part of the variance of a fitted recovery
    spread = 1.0 if recovery is not None and recovery.fired else recorded.spread[level]
    return np.asarray(spread * of_counts / frames / slope**2)


def _counted(
    recovery: Recovery, exposure_s: float, highest_hz: float
) -> tuple[Floats, Floats, Floats]:
    """Rates, with afterpulses, and mean and variance of their counts."""
    if recovery.kind == "paralyzable":
        highest_hz = min(highest_hz, 0.95 / recovery.dead_s)
    grid_hz = np.geomspace(1e-2 / exposure_s, max(highest_hz, 0.1 / exposure_s), 2000)
    mean, variance = recovery.moments(grid_hz, exposure_s)
    return grid_hz / (1 - recovery.fired), np.maximum.accumulate(mean), variance


def _dark_counts(
    recorded: _Recorded, recovery: Recovery | None, fits: dict[str, Misfit]
) -> Estimate | str:
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

    # Garwood
    low = np.where(total > 0, chi2.ppf(0.025, 2 * np.maximum(total, 1e-9)) / 2, 0.0)
    value, ends = rate_of(total), (low, chi2.isf(0.025, 2 * (total + 1)) / 2)
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
    levels = np.flatnonzero(is_dark).tolist()
    rates = np.array([_rates(recorded, at, recorded.mean[at], recovery) for at in levels])
    variance = [_variance(recorded, at, np.maximum(value, 1e-9), recovery) for at in levels]
    weight = recorded.used[is_dark] / np.array(variance)
    common = (weight * rates).sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-300)
    fits["dark counts"] = pooled_misfit(rates - common, weight, common + 0 * rates, 1)
    # to first order, both kinds of dead time hide the same counts
    hidden = 1 + value * (recovery.dead_s if recovery else 0.0)
    return Estimate(value, low, high).where(number > 0).scaled(hidden)


def _telegraph(
    recorded: _Recorded, dark: Mapping[int, pixels.Correlation], recovery: Recovery | None
) -> Switching | None:
    """Switching pixels, from the recording in the dark with the most counts."""
    marked = np.zeros(recorded.used.shape[1:], np.bool_)
    for level, correlation in dark.items():
        marked |= correlation.is_telegraph & recorded.used[level]
    if not marked.any():
        return None
    best = max(dark, key=lambda level: float(recorded.total[level, marked].sum()))
    *means, frames = pixels.switching(
        recorded.mean[best], recorded.variance[best], dark[best], marked
    )
    low_hz, high_hz = (_rates(recorded, best, mean, recovery) for mean in means)
    # the largest ratio that data can distinguish from an infinite one
    low_hz = np.maximum(low_hz, high_hz / 50.0)
    return Switching(marked, low_hz, high_hz, frames * float(recorded.exposure_s[best]))


def _efficiency(
    recorded: _Recorded,
    recovery: Recovery | None,
    fitted: DeadTimeEstimate | None,
    fits: dict[str, Misfit],
) -> Estimate | str:
    """Slope of rates over light, by weighted least squares, or why not."""
    lights = np.unique(recorded.light_hz)
    if len(lights) < 2:
        need = "the dark or a second light" if lights.max() else "a recording under uniform light"
        return f"needs {need}"
    brightest, levels = lights.max(), range(len(recorded.mean))
    light = (recorded.light_hz / brightest)[:, None, None]
    rate_hz = np.array([_rates(recorded, at, recorded.mean[at], recovery) for at in levels])
    line_hz = rate_hz
    if fitted is not None:  # of the typical pixel
        line_hz = np.median(fitted.fit.arrivals_hz, axis=1)[:, None, None] * np.ones_like(rate_hz)
    for _ in range(4):  # each with variances at the line of the previous one
        variance = [_variance(recorded, at, line_hz[at], recovery) for at in levels]
        weight = recorded.used / np.array(variance)
        if recovery is not None and recovery.kind == "paralyzable":
            # near the maximum of the curve, at 1, and beyond it, readings do not tell rates
            weight *= line_hz * recovery.dead_s < 0.8
        s, sx, sxx, sy, sxy = (
            (weight * values).sum(axis=0)
            for values in (np.ones_like(light), light, light**2, rate_hz, light * rate_hz)
        )
        det = s * sxx - sx**2
        det = np.where(det > 1e-12 * np.maximum(s * sxx, 1e-300), det, np.nan)
        intercept, slope, slope_variance = (
            np.nan_to_num(of / det) for of in (sxx * sy - sx * sxy, s * sxy - sx * sy, s)
        )
        line_hz = np.maximum(intercept + slope * light, 0)
    fits["efficiency"] = pooled_misfit(rate_hz - line_hz, weight * (slope > 0), line_hz, 2)
    if fits["efficiency"].is_clear:
        return (
            f"rates are not proportional to light ({fits['efficiency'].summary(recorded.names)}); "
            "check the lights, or record dimmer and brighter ones, so that dead time is found"
        )
    shared = fitted.efficiency_error if fitted is not None else 0.0
    error = np.hypot(np.sqrt(slope_variance), shared * slope) / brightest
    several = np.sum([(weight[recorded.light_hz == hz] > 0).any(axis=0) for hz in lights], axis=0)
    error = np.where((several > 1) & (error > 0), error, np.nan)
    return Estimate.normal(slope / brightest, error, (error.shape[0], error.shape[1]))
