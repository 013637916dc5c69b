"""Offset, leak, step and read noise of each pixel from its comb, by maximum likelihood.

A reading shows the fall of the output

    y = a + l·T + s·N + r·z          z normal; N events, Poisson at the level's own mean

whose N is not known. Expectation–maximization: given the four parameters, each reading has a
posterior over the three nearest N; given these, (a, l, s) are a weighted least-squares line and r²
its residual. Intervals are from the observed information, that of complete data less the
information which is missing because N is not known (T. A. Louis, J. R. Stat. Soc. B 44, 226, 1982).
Where the comb is clear, all of this is an ordinary regression on numbers of events.

The start: steps from `comb_period`, the offset from the dark means at short exposures. Levels then
join in the order of their exposure, so that the leak known so far says which tooth is which.

Source: PCH-EM, Hendrickson and Haefner, arXiv 2302.00090 and 2403.04498, which has one level and
no leak.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from megalopta.sensor.calibrate.level import Falls

Floats = NDArray[np.float64]

_NEIGHBORS = np.arange(-1, 2)
_ROUNDS_OF_START = 2
_MOST_ROUNDS = 30
_CONVERGED = 1e-8
_CLEAR = 0.12
"""Read noise over step below which no reading is between two teeth."""


class CombFit(NamedTuple):
    """Parameters of each pixel (P, 3): fall without counts V, leak V/s, step V; and noise."""

    solution: Floats
    covariance: Floats
    """(P, 3, 3)"""
    noise_v: Floats
    """(P,) read noise and rounding together."""
    counts: Floats
    """(levels, P) sums of events over all frames; 0 where the level was left out."""
    readings: Floats
    """(P,) readings behind the noise."""


def fit_comb(falls: Falls, exposure_s: Floats, step_v: Floats, offset_v: Floats) -> CombFit:
    """Fit the comb of each pixel from steps and offsets that are nearly right, each (P,) in V."""
    entries = _Entries.of(falls, exposure_s)
    solution = np.stack([offset_v, np.zeros_like(step_v), step_v], axis=-1)
    noise = np.full(step_v.size, 0.1) * step_v
    solution, noise = _started(entries, solution, noise)
    if np.median(noise / solution[:, 2]) < _CLEAR:
        numbers = _nearest(entries, solution)[None]
        weights = np.ones_like(numbers)
    else:
        solution, noise, weights, numbers = _maximized(entries, falls, solution, noise)
    covariance = _covariance(entries, weights, numbers, solution, noise)
    expected = (weights * numbers).sum(axis=0) * entries.times
    counts = np.zeros_like(falls.mean_v)
    np.add.at(counts, (entries.level, entries.pixel), expected)
    used = _sums(entries, (weights * (numbers >= entries.fewest)).sum(axis=0))
    return CombFit(solution, covariance, noise, counts, used)


class _Entries(NamedTuple):
    level: NDArray[np.int64]
    pixel: NDArray[np.int64]
    fall: Floats
    times: Floats
    exposure: Floats
    pixels: int
    fewest: int
    """Readings of fewer events are left out of the line."""

    @classmethod
    def of(cls, falls: Falls, exposure_s: Floats) -> "_Entries":
        return cls(
            falls.level,
            falls.pixel,
            falls.fall_v,
            falls.times,
            exposure_s[falls.level],
            falls.frames.shape[1],
            int(falls.is_cut),
        )

    def at(self, chosen: NDArray[np.bool_]) -> "_Entries":
        return self._replace(
            level=self.level[chosen],
            pixel=self.pixel[chosen],
            fall=self.fall[chosen],
            times=self.times[chosen],
            exposure=self.exposure[chosen],
        )


def _started(entries: _Entries, solution: Floats, noise: Floats) -> tuple[Floats, Floats]:
    """Let levels join by exposure, each read with what the shorter ones say."""
    for longest in np.unique(entries.exposure):
        some = entries.at(entries.exposure <= longest)
        for _ in range(_ROUNDS_OF_START):
            numbers = _nearest(some, solution)[None]
            found, noise, regular = _regression(some, np.ones_like(numbers), numbers)
            solution = np.where(regular[:, None], found, solution)
    return solution, noise


def _nearest(entries: _Entries, solution: Floats) -> Floats:
    """Number of events whose tooth is nearest to each reading, (E,)."""
    a, leak, step = solution[entries.pixel].T
    return np.asarray(np.rint((entries.fall - a - leak * entries.exposure) / step).clip(0))


def _maximized(
    entries: _Entries, falls: Falls, solution: Floats, noise: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Expectation and maximization in turn, until nothing moves."""
    for _ in range(_MOST_ROUNDS):
        means = _means(entries, solution, falls)
        weights, numbers = _posterior(entries, solution, noise, means)
        before = solution
        solution, noise, _ = _regression(entries, weights, numbers)
        if np.median(np.abs(solution - before) / np.abs(solution).max(axis=0)) < _CONVERGED:
            break
    weights, numbers = _posterior(entries, solution, noise, _means(entries, solution, falls))
    return solution, noise, weights, numbers


def _means(entries: _Entries, solution: Floats, falls: Falls) -> Floats:
    """Mean number of events of each level and pixel."""
    exposure = np.zeros(len(falls.mean_v))
    exposure[entries.level] = entries.exposure
    a, leak, step = solution.T
    return np.asarray(np.maximum((falls.mean_v - a - leak * exposure[:, None]) / step, 1e-3))


def _posterior(
    entries: _Entries, solution: Floats, noise: Floats, means: Floats
) -> tuple[Floats, Floats]:
    """Chances of the numbers of events near each reading, and these, (3, E)."""
    a, leak, step = solution[entries.pixel].T
    nearest = (entries.fall - a - leak * entries.exposure) / step
    numbers = np.rint(nearest) + _NEIGHBORS[:, None]
    mean = means[entries.level, entries.pixel]
    width = (noise / solution[:, 2])[entries.pixel]
    chance = -0.5 * ((nearest - numbers) / width) ** 2
    chance += numbers * np.log(mean) - gammaln(numbers.clip(0) + 1)
    chance = np.where(numbers < 0, -np.inf, chance)
    best = chance.max(axis=0)
    # a reading far above no count at all stands for none
    weights = np.exp(chance - np.where(np.isfinite(best), best, 0))
    lost = ~np.isfinite(best)
    weights[:, lost], numbers[:, lost] = 1, 0
    return weights / weights.sum(axis=0), numbers


def _sums(entries: _Entries, values: Floats) -> Floats:
    return np.bincount(entries.pixel, entries.times * values, entries.pixels).astype(np.float64)


def _regression(
    entries: _Entries, weights: Floats, numbers: Floats
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Least squares of each pixel, residual noise, and where the line is determined."""
    weights = weights * (numbers >= entries.fewest)
    normal, right = _normal_equations(entries, weights, numbers)
    regular = np.linalg.cond(_scaled(normal)[0]) < 1e12
    scaled, scale = _scaled(normal)
    solution = np.einsum("pij,pj->pi", np.linalg.pinv(scaled, hermitian=True), right / scale)
    solution = solution / scale
    a, leak, step = solution[entries.pixel].T
    residual = entries.fall - a - leak * entries.exposure - step * numbers
    squares = _sums(entries, (weights * residual**2).sum(axis=0))
    frames = np.maximum(_sums(entries, weights.sum(axis=0)) - 3, 1)
    return solution, np.sqrt(np.maximum(squares / frames, 1e-18)), regular


def _normal_equations(entries: _Entries, weights: Floats, numbers: Floats) -> tuple[Floats, Floats]:
    T, y = entries.exposure, entries.fall
    zeroth, first, second = (_moment(weights, numbers, power) for power in range(3))
    normal = np.empty((entries.pixels, 3, 3))
    for (row, column), values in {
        (0, 0): zeroth,
        (0, 1): T * zeroth,
        (0, 2): first,
        (1, 1): T**2 * zeroth,
        (1, 2): T * first,
        (2, 2): second,
    }.items():
        normal[:, row, column] = normal[:, column, row] = _sums(entries, values)
    right = np.stack(
        [_sums(entries, each) for each in (y * zeroth, T * y * zeroth, first * y)], axis=-1
    )
    return normal, right


def _moment(weights: Floats, numbers: Floats, power: int) -> Floats:
    return np.asarray((weights * numbers**power).sum(axis=0))


def _scaled(normal: Floats) -> tuple[Floats, Floats]:
    scale = np.sqrt(np.maximum(np.diagonal(normal, axis1=1, axis2=2), 1e-30))
    return normal / scale[:, :, None] / scale[:, None, :], scale


def _covariance(
    entries: _Entries, weights: Floats, numbers: Floats, solution: Floats, noise: Floats
) -> Floats:
    """Inverse of the observed information."""
    used = weights * (numbers >= entries.fewest)
    complete = _normal_equations(entries, used, numbers)[0] / noise[:, None, None] ** 2
    a, leak, step = solution[entries.pixel].T
    residual = entries.fall - a - leak * entries.exposure - step * numbers
    if len(weights) == 1:
        missing = 0 * complete
    else:
        missing = _missing(entries, weights, numbers, residual / noise[entries.pixel] ** 2)
    scaled, scale = _scaled(complete - missing)
    inverse = np.linalg.pinv(scaled, hermitian=True)
    return np.asarray(inverse / scale[:, :, None] / scale[:, None, :])


def _missing(entries: _Entries, weights: Floats, numbers: Floats, pull: Floats) -> Floats:
    """Information that is missing because numbers of events are not known, (P, 3, 3)."""
    one = np.ones_like(numbers)
    regressors = np.stack([one, one * entries.exposure, numbers])
    scores = regressors * pull * (numbers >= entries.fewest)
    mean = (weights * scores).sum(axis=1)
    missing = np.empty((entries.pixels, 3, 3))
    for row in range(3):
        for column in range(3):
            product = (weights * scores[row] * scores[column]).sum(0) - mean[row] * mean[column]
            missing[:, row, column] = _sums(entries, product)
    return missing
