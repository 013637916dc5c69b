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
from scipy.special import gammaln

from megalopta.arrays import Floats
from megalopta.sensor.calibrate.comb_line import Readings, covariance_of, regression
from megalopta.sensor.calibrate.level import Falls

_NEIGHBORS = np.arange(-1.0, 2.0)
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
    readings = Readings.of(falls, exposure_s)
    solution = np.stack([offset_v, np.zeros_like(step_v), step_v], axis=-1)
    noise = np.full(step_v.size, 0.1) * step_v
    solution, noise = _started(readings, solution, noise)
    if np.median(noise / solution[:, 2]) < _CLEAR:
        numbers = _nearest(readings, solution)[None]
        weights = np.ones_like(numbers)
    else:
        solution, noise, weights, numbers = _maximized(readings, falls, solution, noise)
    covariance = covariance_of(readings, weights, numbers, solution, noise)
    expected = (weights * numbers).sum(axis=0) * readings.times
    counts = np.zeros_like(falls.mean_v)
    np.add.at(counts, (readings.level, readings.pixel), expected)
    used = readings.sums((weights * (numbers >= readings.fewest)).sum(axis=0))
    return CombFit(solution, covariance, noise, counts, used)


def _started(readings: Readings, solution: Floats, noise: Floats) -> tuple[Floats, Floats]:
    """Let levels join by exposure, each read with what the shorter ones say."""
    for longest in np.unique(readings.exposure):
        some = readings.at(readings.exposure <= longest)
        for _ in range(_ROUNDS_OF_START):
            numbers = _nearest(some, solution)[None]
            found, noise, regular = regression(some, np.ones_like(numbers), numbers)
            solution = np.where(regular[:, None], found, solution)
    return solution, noise


def _nearest(readings: Readings, solution: Floats) -> Floats:
    """Number of events whose tooth is nearest to each reading, (E,)."""
    fall, step = readings.above(solution)
    return np.asarray(np.rint(fall / step).clip(0))


def _maximized(
    readings: Readings, falls: Falls, solution: Floats, noise: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Expectation and maximization in turn, until nothing moves."""
    for _ in range(_MOST_ROUNDS):
        means = _means(readings, solution, falls)
        weights, numbers = _posterior(readings, solution, noise, means)
        before = solution
        solution, noise, _ = regression(readings, weights, numbers)
        if np.median(np.abs(solution - before) / np.abs(solution).max(axis=0)) < _CONVERGED:
            break
    weights, numbers = _posterior(readings, solution, noise, _means(readings, solution, falls))
    return solution, noise, weights, numbers


def _means(readings: Readings, solution: Floats, falls: Falls) -> Floats:
    """Mean number of events of each level and pixel."""
    exposure = np.zeros(len(falls.mean_v))
    exposure[readings.level] = readings.exposure
    a, leak, step = solution.T
    return np.asarray(np.maximum((falls.mean_v - a - leak * exposure[:, None]) / step, 1e-3))


def _posterior(
    readings: Readings, solution: Floats, noise: Floats, means: Floats
) -> tuple[Floats, Floats]:
    """Chances of the numbers of events near each reading, and these, (3, E)."""
    fall, step = readings.above(solution)
    nearest = fall / step
    numbers = np.rint(nearest) + _NEIGHBORS[:, None]
    mean = means[readings.level, readings.pixel]
    width = (noise / solution[:, 2])[readings.pixel]
    chance = -0.5 * ((nearest - numbers) / width) ** 2
    chance += numbers * np.log(mean) - gammaln(numbers.clip(0) + 1)
    chance = np.where(numbers < 0, -np.inf, chance)
    best = chance.max(axis=0)
    # a reading far above no count at all stands for none
    weights = np.exp(chance - np.where(np.isfinite(best), best, 0))
    lost = ~np.isfinite(best)
    weights[:, lost], numbers[:, lost] = 1, 0
    return weights / weights.sum(axis=0), numbers
