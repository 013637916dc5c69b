"""Dead time of either kind next to afterpulses, recharging and twilight, of an array of counters.

**Model.** All pixels recover alike after a count, from which follow mean M and variance V of their
counts at a rate of arrivals (`sensor/spad/moments.py`). Arrivals d + η·φ, d dark counts and φ the
light, are each pixel's own. At low rates a, counts are a/(1 − q), where q = p·e^(−τ/δ) of the p
carriers that a count leaves in traps outlast the dead time τ, released after a delay δ.

**Fit.** Normal means of variance V/n, and of every recording the mean over pixels of observed
variance over V, whose error is its scatter between pixels. The shared parameters follow by
Gauss–Newton, those of pixels eliminated (Schur complement). The delay is fitted from the best of
several; those within 3.84 of the smallest χ² are the range that fits, which widens intervals. Both
kinds are fitted: one is clear if likelihoods differ by more than a factor e⁶ (400 to 1), and so is
a slow recovery.

Source: dissertation §2.3.3, Eq. 2.5 and 2.6; Knoll, Radiation Detection and Measurement, ch. 4.
"""

from collections.abc import Mapping
from contextlib import suppress
from operator import attrgetter
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError
from megalopta.core.quantities import between, with_error
from megalopta.sensor.calibrate.level import inverses
from megalopta.sensor.calibrate.misfit import Misfit, pooled_misfit
from megalopta.sensor.effects.afterpulsing import Afterpulsing
from megalopta.sensor.effects.dead_time import DeadTime
from megalopta.sensor.spad.model import AvalancheEffects
from megalopta.sensor.spad.moments import Moments, lagrange_weights, pixel_moments

DeadTimeKind = Literal["paralyzable", "nonparalyzable"]
KINDS: tuple[DeadTimeKind, ...] = get_args(DeadTimeKind)
_SLOW = ("recharge_s", "twilight_s")
_NODES, _ROUNDS, _NUDGE = 4, 20, 1e-3
_CLEAR, _95, _FAR = 12.0, 3.84, 1000.0
"""Differences of χ² between models that differ, within a 95 % CI, and beyond that of any delay"""


class Recovery(NamedTuple):
    """Parameters of the recovery of a pixel from a count; times in s."""

    kind: DeadTimeKind
    dead_s: float
    fired: float = 0.0
    """Afterpulses per count in dim light, q"""
    delay_s: float = 1.0
    recharge_s: float = 0.0
    twilight_s: float = 0.0

    @property
    def carriers(self) -> float:
        """Mean number of carriers that a count leaves in traps."""
        return min(self.fired * float(np.exp(min(self.dead_s / self.delay_s, 50.0))), 0.95)

    @property
    def dead_time(self) -> DeadTime:
        """Setting of a sensor."""
        return DeadTime(
            kind=self.kind, dead_time_s=self.dead_s, recharge_s=self.recharge_s,
            twilight_s=min(self.twilight_s, self.dead_s / 2),
        )  # fmt: skip

    def moments(self, rate_hz: Floats, exposure_s: float) -> Moments:
        """Return mean and variance of the counts at rates of arrivals, of any shape."""
        traps = Afterpulsing(mean_carriers=self.carriers, delay_s=self.delay_s)
        effects = AvalancheEffects(dead_time=self.dead_time, afterpulsing=traps)
        return pixel_moments(rate_hz, exposure_s, effects)


class Curves(NamedTuple):
    """Counts of some pixels, (levels, P), over light and exposure, (levels,)."""

    mean: Floats
    variance: Floats
    frames: Floats
    """0: not used"""
    exposure_s: Floats
    light_hz: Floats
    talk: float = 0.0
    """Neighbors that a count fires"""

    @property
    def pooled(self) -> "Curves":
        """Counts of a pixel that is the mean of all that are used at each level."""
        share = self.frames / np.maximum(self.frames.sum(axis=1, keepdims=True), 1)
        mean, variance = ((share * of).sum(axis=1, keepdims=True) for of in self[:2])
        frames = self.frames.sum(axis=1, keepdims=True)
        return self._replace(mean=mean, variance=variance, frames=frames)


class Fit(NamedTuple):
    """A fitted recovery."""

    recovery: Recovery
    names: tuple[str, ...]
    """Fitted parameters"""
    covariance: Floats
    """Of their logarithms"""
    chi2: float
    misfit: Misfit
    arrivals_hz: Floats
    """(levels, P)"""
    own: Floats
    """Dark counts and efficiency of each pixel, (2, P)"""
    efficiency_error: float
    """Relative standard error of the efficiency that all pixels share"""

    def error(self, name: str) -> float:
        """Return the standard error of a parameter, 0 if it was not fitted."""
        if name not in self.names:
            return 0.0
        at = self.names.index(name)
        return float(getattr(self.recovery, name) * np.sqrt(max(self.covariance[at, at], 0.0)))


_chi2 = attrgetter("chi2")


class _State(NamedTuple):
    """Moments (levels, P) of the present parameters."""

    mean: Floats
    spread: Floats
    """Variance over mean"""
    slope: Floats
    """Of the mean over arrivals per second"""


def _state(curves: Curves, recovery: Recovery, arrivals_hz: Floats) -> _State:
    """Interpolate the moments of each level between a few rates."""
    parts = []
    for arrivals, exposure_s, light_hz in zip(
        arrivals_hz, curves.exposure_s, curves.light_hz, strict=True
    ):
        number = _NODES if light_hz else 2
        low, high = np.log(np.quantile(arrivals, (0.0, 1.0)).clip(np.median(arrivals) / 30 + 1e-9))
        places = (1 - np.cos(np.pi * (np.arange(number) + 0.5) / number)) / 2
        nodes = low - 0.02 + (high - low + 0.04) * places
        mean, variance = recovery.moments(np.exp(nodes), float(exposure_s))
        logs = np.column_stack([np.log(mean) - nodes, np.log((variance / mean).clip(1e-9))])
        x = np.log(np.maximum(arrivals, np.exp(low)))
        live, spread = np.exp(lagrange_weights(x, nodes) @ logs).T
        ahead = np.exp(lagrange_weights(x + _NUDGE, nodes) @ logs[:, 0])
        # negative beyond the maximum of a paralyzable curve
        slope = live + (ahead - live) / _NUDGE
        parts.append((live * arrivals, spread, slope))
    return _State(*np.array(parts).transpose(1, 0, 2))


def _first_rates(curves: Curves, start: Recovery) -> Floats:
    """Dark counts and efficiency of each pixel, (2, P), from the dark and the dimmest light."""
    rate = (1 - start.fired) * curves.mean / curves.exposure_s[:, None]
    dark = (curves.frames > 0) & (curves.light_hz == 0)[:, None]
    dark_hz = (rate * dark).sum(axis=0) / np.maximum(dark.sum(axis=0), 1)
    is_lit = (curves.frames > 0) & (curves.light_hz > 0)[:, None]
    dimmest = np.argmin(np.where(is_lit, curves.light_hz[:, None], np.inf), axis=0)
    lit_hz = rate[dimmest, np.arange(dark_hz.size)]
    arrivals_hz = lit_hz / np.maximum(1 - lit_hz * start.dead_s, 0.3)
    return np.array([dark_hz, np.maximum(arrivals_hz - dark_hz, 0) / curves.light_hz[dimmest]])


class _Equations(NamedTuple):
    """Normal equations of the shared parameters, those of pixels eliminated."""

    information: Floats
    score: Floats
    inner: Floats
    """Inverse of those of each pixel, (P, 2, 2)"""
    right: Floats
    mixed: Floats
    chi2: float
    misfit: Misfit


def _equations(
    curves: Curves, recovery: Recovery, names: tuple[str, ...], arrivals_hz: Floats,
    light_hz: Floats, state: _State,
) -> _Equations:  # fmt: skip
    """Set up the equations from slopes over the logarithms of parameters."""
    used = curves.frames > 0
    variance = np.maximum(state.mean * state.spread, 1e-9)
    weight, left = curves.frames / variance, curves.mean - state.mean
    ratio, error = _variance_ratios(curves, variance)
    columns = [state.slope, state.slope * light_hz[:, None]]
    slopes = np.zeros((len(names), len(light_hz)))
    for name, slope in zip(names, slopes, strict=True):
        nudged = recovery._replace(**{name: getattr(recovery, name) * np.exp(_NUDGE)})
        mean, spread, _ = _state(curves, nudged, arrivals_hz)
        columns.append((mean - state.mean) / _NUDGE)
        of_spread = np.log(spread / state.spread) / _NUDGE
        slope[:] = ratio * (of_spread * used).sum(axis=1) / np.maximum(used.sum(axis=1), 1)
    design = np.stack(columns, axis=-1)
    normal = np.einsum("lp,lpi,lpj->pij", weight, design, design)
    right = np.einsum("lp,lpi,lp->pi", weight, design, left)
    inner = inverses(normal[:, :2, :2], 1e-12)
    mixed = np.einsum("pij,pjk->pik", inner, normal[:, :2, 2:])
    information = (normal[:, 2:, 2:] - normal[:, 2:, :2] @ mixed).sum(axis=0)
    score = (right[:, 2:] - np.einsum("pi,pij->pj", right[:, :2], mixed)).sum(axis=0)
    z = (ratio - 1) / error
    total = np.sum(weight * left**2 + used * np.log(variance)) + np.sum(z**2)
    # counts of neighbors are correlated
    weight = weight / (1 + 2 * curves.talk)
    misfit = pooled_misfit(left, weight, state.mean, 2 + len(names), (ratio - 1, error))
    return _Equations(
        information + (slopes / error**2) @ slopes.T, score + slopes @ (z / error), inner,
        right[:, :2], mixed, float(total), misfit,
    )  # fmt: skip


def _fitted(
    curves: Curves,
    start: Recovery,
    names: tuple[str, ...],
    rounds: int = _ROUNDS,
    near: Fit | None = None,
) -> Fit:
    """Fit some parameters, and dark counts and efficiency of each pixel, at first those nearby."""
    own, alone = (_first_rates(curves, start), 2) if near is None else (near.own, 0)
    recovery, light_hz, least = start, curves.light_hz, np.inf
    for turn in range(rounds + 1):
        arrivals_hz = np.maximum(own[0] + own[1] * light_hz[:, None], 1e-9)
        state = _state(curves, recovery, arrivals_hz)
        # neighbors fire in proportion to counts, not to arrivals
        live = np.median(state.mean / arrivals_hz, axis=1) / curves.exposure_s
        light_hz = curves.light_hz * (1 - curves.talk)
        light_hz = light_hz / (1 - curves.talk * live * (1 - start.fired))
        of = _equations(curves, recovery, names, arrivals_hz, light_hz, state)
        covariance = inverses(of.information, 1e-12)
        if turn == rounds or (turn > alone + 1 and abs(least - of.chi2) < 0.01):
            break
        least = of.chi2
        # parameters of pixels first
        step = np.clip(covariance @ of.score, -0.3, 0.3) * (turn >= alone)
        change = np.einsum("pij,pj->ip", of.inner, of.right)
        change -= np.einsum("pij,j->ip", of.mixed, step)
        # dark counts may be unknown at first, and without recordings of them below 0 by noise
        half_hz = own[1] * curves.light_hz[curves.light_hz > 0].min() / 2
        reach = np.array([half_hz, 0 * half_hz])
        own = np.clip(own + change, own / 2 - reach, 2 * own + reach)
        values = np.exp(step) * [getattr(recovery, name) for name in names]
        # a much faster recovery is that of no recharging, and takes long to compute
        least_s = [0.01 * recovery.dead_s * (name in _SLOW) for name in names]
        values = np.maximum(values, least_s).tolist()
        recovery = recovery._replace(**dict(zip(names, values, strict=True)))
    covariance = covariance * (1 + 2 * curves.talk)
    shared = np.einsum("pj,jk,pk->p", of.mixed[:, 1], covariance, of.mixed[:, 1]) / own[1] ** 2
    efficiency_error = float(np.sqrt(np.median(shared)))
    return Fit(recovery, names, covariance, of.chi2, of.misfit, arrivals_hz, own, efficiency_error)


def _variance_ratios(curves: Curves, variance: Floats) -> tuple[Floats, Floats]:
    """Mean over pixels of observed over modelled variance of each level, and its error."""
    used = curves.frames > 0
    number = used.sum(axis=1)
    ratio = np.where(used, curves.variance / variance, 0)
    mean = ratio.sum(axis=1) / np.maximum(number, 1)
    square = (np.where(used, ratio - mean[:, None], 0) ** 2).sum(axis=1)
    error = np.sqrt(square) / np.maximum(number, 1)
    # of a single pixel, as of normal counts
    alone = np.sqrt(2 / np.maximum(curves.frames.max(axis=1), 1))
    error = np.hypot(np.where(number > 9, error, alone), 1e-3)  # error of the model's variance
    return np.where(number > 0, mean, 1.0), np.where(number > 0, error, np.inf)


class DeadTimeEstimate(NamedTuple):
    """The most likely recovery of an array, and what else fits."""

    fit: Fit
    error_s: float
    """Standard errors of dead time, afterpulses, and, relative, the efficiency that all pixels
    share, of whatever delay fits"""
    fired_error: float
    efficiency_error: float
    is_kind_clear: bool
    delays_s: tuple[float, float] | None
    """Range that fits, 95 % CI; None without afterpulses"""
    slow_limits: Mapping[str, float]
    """Recharging and twilight (s) that frames do not exclude, 95 %, if they are not fitted"""

    @property
    def recovery(self) -> Recovery:
        """Parameters of the fit."""
        return self.fit.recovery

    def __str__(self) -> str:
        """Dead time and kind, with recharging, twilight and delay, and what is not excluded."""
        dead_s, most = with_error(self.recovery.dead_s, 1.96 * self.error_s, "s"), []
        doubt = "" if self.is_kind_clear else "kind undetermined, taken as "
        text = f"{dead_s} ({doubt}{self.recovery.kind}"
        for name, word in (("recharge_s", "recharging"), ("twilight_s", "twilight")):
            if seconds := getattr(self.recovery, name):
                text += f", {word} {with_error(seconds, 0, 's')}"
            if (limit_s := self.slow_limits.get(name, np.inf)) < self.recovery.dead_s:
                most.append(f"{word} up to {with_error(limit_s, 0, 's')}")
        if self.delays_s is not None:
            text += f"; afterpulses after {between(*self.delays_s, 's')} (95 % CI)"
        return text + (f"; not excluded: {' or '.join(most)})" if most else ")")


def fit_recovery(curves: Curves, fired: float) -> DeadTimeEstimate:
    """Fit recovery to counts, with afterpulses if they have been seen (`fired` > 0)."""
    starts = {kind: _start(curves, kind, fired) for kind in KINDS}
    least = min(fit.chi2 for fit in starts.values())
    groups = {
        kind: _over_delays(curves, start) if fired and start.chi2 < least + _FAR else [start]
        for kind, start in starts.items()
    }
    bests = {kind: min(group, key=_chi2) for kind, group in groups.items()}
    best, second_best = sorted(bests.values(), key=_chi2)
    group, plain = groups[best.recovery.kind], bests["nonparalyzable"]
    is_kind_clear, limits = second_best.chi2 - best.chi2 > _CLEAR, {}
    doubt, slow = best.misfit.p < 1e-3, [best]
    is_alone = not fired and best is plain
    for name in _SLOW if doubt or is_alone else ():
        slow_s: dict[str, Any] = {name: 0.3 * plain.recovery.dead_s}
        start = plain.recovery._replace(**slow_s)
        with suppress(UserError):  # its curve takes too long to compute
            fit = _fitted(curves, start, (*plain.names, name), _ROUNDS if doubt else 1, plain)
            limits[name] = getattr(fit.recovery, name) + 1.645 * fit.error(name)
            slow.append(fit)
    fastest, second = sorted([*slow, best], key=_chi2)[:2]
    if doubt and best.chi2 - fastest.chi2 > _CLEAR:
        best, group, is_kind_clear = fastest, [fastest], second.chi2 - fastest.chi2 > _CLEAR
    if not is_alone or best is not plain:
        limits = {}
    fitting = [fit for fit in group if fit.chi2 < best.chi2 + _95]

    # ends of 95 % CI of dead time, afterpulses and efficiency, of the profile over delays
    ends = []
    for fit in fitting:
        ratio = np.median(fit.own[1] / best.own[1])
        values = *np.subtract(fit.recovery[1:3], best.recovery[1:3]), ratio - 1
        errors = fit.error("dead_s"), fit.error("fired"), fit.efficiency_error
        ends.append(np.abs(values) + np.sqrt(_95 - fit.chi2 + best.chi2) * np.array(errors))
    delays_s = None
    if fired:
        delay_s, error_s = best.recovery.delay_s, 1.96 * best.error("delay_s")
        fits_s = [fit.recovery.delay_s for fit in fitting]
        known_s = [fit.recovery.delay_s for fit in groups[best.recovery.kind]]
        low, high = min(*fits_s, delay_s - error_s), max(*fits_s, delay_s + error_s)
        delays_s = max(low, min(known_s)), min(high, max(known_s))
    error_s, fired_error, efficiency_error = (np.max(ends, axis=0) / np.sqrt(_95)).tolist()
    return DeadTimeEstimate(
        best, error_s, fired_error, efficiency_error, is_kind_clear, delays_s, limits
    )


def _start(curves: Curves, kind: DeadTimeKind, fired: float) -> Fit:
    """Fit from the best of several dead times, with afterpulses after four of them."""
    shortest_s = float(curves.exposure_s[curves.light_hz > 0].min())
    dead_times_s = (np.geomspace(1e-5, 0.25, 20) * shortest_s).tolist()
    fits = [_fitted(curves.pooled, Recovery(kind, dead_s), (), 4) for dead_s in dead_times_s]
    start = min(fits, key=_chi2).recovery
    if not fired:
        return _fitted(curves, start, ("dead_s",))
    start = start._replace(fired=fired, delay_s=min(4 * start.dead_s, shortest_s / 4))
    return _fitted(curves, start, ("dead_s", "fired"))


def _over_delays(curves: Curves, start: Fit) -> list[Fit]:
    """Fits with afterpulses of several delays, and of a fitted one."""
    shortest_s, fits = float(curves.exposure_s[curves.light_hz > 0].min()), [start]
    for factor in (1 / 16, 1 / 4, 4, 16):
        if (delay_s := start.recovery.delay_s * factor) < shortest_s:
            known = start.recovery._replace(delay_s=delay_s)
            fits.append(_fitted(curves, known, start.names, near=start))
    near = min(fits, key=_chi2)
    return [*fits, _fitted(curves, near.recovery, (*start.names, "delay_s"), near=near)]
