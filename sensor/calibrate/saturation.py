"""Dark counts, efficiency and dead time of each pixel from mean counts over light.

Arrivals of rate r = d + η·φ, d dark counts and φ the light, give counts with the mean M and the
variance V of a live start (`sensor/effects`). (d, η, τ) maximize the likelihood of normal means of
known variance V/n, by Fisher scoring from the best of several dead times. Both kinds are fitted:
the more likely one is named if the likelihoods over all pixels, with their own dead times or one in
common, differ by more than a factor e⁶ (400 to 1).

Source: dissertation §2.3.3, Eq. 2.5 and 2.6; Knoll, Radiation Detection and Measurement, ch. 4.
"""

from collections.abc import Callable
from typing import Literal, NamedTuple, get_args

import numpy as np
from scipy.stats import chi2

from megalopta.core.arrays import Floats
from megalopta.sensor.calibrate.level import inverses
from megalopta.sensor.effects.dead_time import COUNT_DISTRIBUTIONS

DeadTimeKind = Literal["paralyzable", "nonparalyzable"]
KINDS: tuple[DeadTimeKind, ...] = get_args(DeadTimeKind)


class SaturationFit(NamedTuple):
    """Rates of each pixel, (P, 3): dark counts Hz, efficiency, dead time s."""

    kind: DeadTimeKind
    solution: Floats
    covariance: Floats
    """(P, 3, 3)"""
    log_likelihood: Floats
    """(P,)"""


class MeanCounts(NamedTuple):
    """Counts at each level (levels, P); unknown where there are no frames."""

    mean: Floats
    frames: Floats
    exposure_s: Floats
    """(levels,)"""
    light_hz: Floats
    """(levels,)"""


class Misfit(NamedTuple):
    """Deviation of mean counts from a fitted curve."""

    share: float
    """Clearest deviation of a level's mean over the pixels, relative"""
    p: float
    """Chance of as large deviations; NaN: too few levels to tell"""

    @property
    def is_clear(self) -> bool:
        """True if the curve does not hold: beyond chance, and beyond a negligible deviation."""
        return self.p < 1e-6 and abs(self.share) > 1e-3


def misfit(counts: MeanCounts, fit: SaturationFit, spread: float = 1.0) -> Misfit:
    """Return how far means of levels, over all pixels, are from a fit of every pixel.

    `spread` is the variance of counts over that of independent events.
    """
    mean, variance = _moments(counts, fit.solution, fit.kind)
    known = np.isfinite(fit.solution).all(axis=1) & (counts.frames > 0)
    left = np.where(known, counts.mean - mean, 0)
    z = left * np.sqrt(counts.frames / np.where(known, variance, 1) / spread)
    pixels = known.sum(axis=1)
    used = pixels > 0
    freedom = int(used.sum()) - fit.solution.shape[1]
    if freedom < 1:
        return Misfit(0.0, np.nan)
    sums = z.sum(axis=1)[used] / np.sqrt(pixels[used])
    shares = left.sum(axis=1)[used] / np.where(known, mean, 0).sum(axis=1)[used]
    clearest = int(np.argmax(np.abs(sums)))
    return Misfit(float(shares[clearest]), float(chi2.sf((sums**2).sum(), freedom)))


def live_share(counts: MeanCounts, fit: SaturationFit) -> Floats:
    """Return the fitted share of arrivals that are counted, (levels, P)."""
    dark_hz, efficiency, _ = fit.solution.T
    arrivals = (dark_hz + efficiency * counts.light_hz[:, None]) * counts.exposure_s[:, None]
    return np.asarray(_moments(counts, fit.solution, fit.kind)[0] / arrivals)


def dead_time_moments(
    rate_hz: Floats, exposure_s: Floats | float, dead_time_s: Floats, kind: DeadTimeKind
) -> tuple[Floats, Floats]:
    """Return mean and variance of counts; rates (Hz), exposures and dead times (s) broadcast."""
    rate, exposure, dead = np.broadcast_arrays(rate_hz, exposure_s, dead_time_s)
    arrivals, fraction = (rate * exposure).ravel(), (dead / exposure).ravel()
    mean, variance = COUNT_DISTRIBUTIONS[kind].moments(arrivals, fraction, is_stationary=False)
    return mean.reshape(rate.shape), variance.reshape(rate.shape)


def fit_saturation(
    counts: MeanCounts, pooled: Callable[[SaturationFit], float] | None = None
) -> tuple[SaturationFit, float]:
    """Return the fit of the more likely kind, and the log-likelihood ratio.

    With `pooled`, the dead time of all pixels from their fits, kinds are compared where pixels have
    that in common, which tells them apart in dimmer light.

    Raises ValueError if there are fewer than two levels of light.
    """
    if len(np.unique(counts.light_hz[counts.light_hz > 0])) < 2:
        raise ValueError("flat frames of fewer than two lights; capture a dim and a bright one")
    fits = [_fitted(counts, kind) for kind in KINDS]
    joint = [_fitted(counts, fit.kind, pooled(fit)) for fit in fits] if pooled else fits
    totals = [float(np.sum(fit.log_likelihood[np.isfinite(fit.log_likelihood)])) for fit in joint]
    best = int(np.argmax(totals))
    return fits[best], totals[best] - totals[1 - best]


def _fitted(counts: MeanCounts, kind: DeadTimeKind, known_s: float | None = None) -> SaturationFit:
    """Fit one kind of dead time, to efficiency and dark counts alone if it is known."""
    rate = counts.mean / counts.exposure_s[:, None]
    used = counts.frames > 0
    dark = used & (counts.light_hz == 0)[:, None]
    live = np.where(dark, counts.frames * counts.exposure_s[:, None], 0)
    d = (live * rate).sum(0) / np.maximum(live.sum(0), 1e-300)
    light = np.where(used & (counts.light_hz > 0)[:, None], counts.light_hz[:, None], np.inf)
    dimmest = np.argmin(light, axis=0)
    at = dimmest, np.arange(d.size)
    light_hz = np.maximum(counts.light_hz[dimmest], 1e-12)
    is_lit = np.isfinite(light[at])
    solution, most = np.zeros((d.size, 3)), np.full(d.size, -np.inf)
    longest = float(counts.exposure_s[counts.light_hz > 0].min()) / 4
    for tau in np.geomspace(longest * 1e-5, longest, 30):
        observed = np.maximum(rate[at] - d, 1e-9)
        eta = observed / np.maximum(1 - rate[at] * tau, 0.2) / light_hz
        eta = np.where(is_lit, eta, 1e-12)
        trial = np.stack([np.maximum(d, 1e-6), eta, np.full(d.size, tau)], axis=-1)
        value = _likelihood(counts, trial, kind)
        better = value > most
        solution[better], most[better] = trial[better], value[better]
    if known_s is not None:
        solution[:, 2] = known_s
    for _ in range(25):
        gradient, information = _score(counts, solution, kind)
        if known_s is not None:
            gradient[:, 2], information[:, 2], information[:, :, 2] = 0, 0, 0
        step = np.einsum("pij,pj->pi", inverses(information, 1e-12), gradient)
        reach = np.maximum(0.5 * solution, [1.0, 0, 1e-9])
        moved = np.maximum(solution + np.clip(step, -reach, reach), [1e-6, 1e-12, 1e-15])
        solution = np.where(np.isfinite(moved), moved, solution)
    covariance = inverses(_score(counts, solution, kind)[1], 1e-12)
    likelihood = _likelihood(counts, solution, kind)
    undetermined = (used & (counts.light_hz > 0)[:, None]).sum(axis=0) < 2
    solution[undetermined, 1:], covariance[undetermined] = np.nan, np.nan
    return SaturationFit(kind, solution, covariance, likelihood)


def _moments(counts: MeanCounts, solution: Floats, kind: DeadTimeKind) -> tuple[Floats, Floats]:
    d, eta, tau = solution.T
    rate = d + eta * counts.light_hz[:, None]
    mean, variance = dead_time_moments(rate, counts.exposure_s[:, None], tau, kind)
    return mean, np.maximum(variance, 1e-9)


def _likelihood(counts: MeanCounts, solution: Floats, kind: DeadTimeKind) -> Floats:
    mean, variance = _moments(counts, solution, kind)
    terms = counts.frames * (counts.mean - mean) ** 2 / variance + np.log(variance)
    return np.asarray(-0.5 * np.where(counts.frames > 0, terms, 0).sum(axis=0))


def _score(counts: MeanCounts, solution: Floats, kind: DeadTimeKind) -> tuple[Floats, Floats]:
    """Gradient (P, 3) and Fisher information (P, 3, 3) of the means."""
    mean, variance = _moments(counts, solution, kind)
    slopes = []
    for parameter, smallest in enumerate((1e-6, 1e-13, 1e-16)):
        step = np.maximum(solution[:, parameter] * 1e-5, smallest)
        moved = solution.copy()
        moved[:, parameter] += step
        slopes.append((_moments(counts, moved, kind)[0] - mean) / step)
    slope = np.stack(slopes, axis=-1)
    weight = counts.frames / variance
    gradient = np.einsum("lp,lpi->pi", weight * (counts.mean - mean), slope)
    return gradient, np.einsum("lp,lpi,lpj->pij", weight, slope, slope)
