"""Offset, leak, step and read noise of each pixel from its comb, by maximum likelihood.

A reading shows the fall of the output

    y = a + l·T + s·x(N) + r·z       z normal; N events, Poisson at the level's own mean

whose N is not known; x(N) is N where the step is the same over the whole swing (`curve`).
Expectation–maximization: given the four parameters, each reading has a posterior over the three
nearest N; given these, (a, l, s) are a weighted least-squares line and r² its residual. Intervals
are from the observed information, that of complete data less the information which is missing
because N is not known (T. A. Louis, J. R. Stat. Soc. B 44, 226, 1982). Where the comb is clear, all
of this is an ordinary regression on numbers of events.

The slope of the step is one for the whole array: what residuals of all pixels have in common with
the bend of the curve (Gauss–Newton). Where they do not tell it, there is none.

The start: steps from `comb_period`, the offset from the dark means at short exposures. Readings
then join by events and exposure, so that leak and slope known so far say which tooth is which.

Source: PCH-EM, Hendrickson and Haefner, arXiv 2302.00090 and 2403.04498, which has one level and
no leak.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import gammaln

from megalopta.core.arrays import Floats
from megalopta.sensor.calibrate.comb_errors import covariance_of
from megalopta.sensor.calibrate.comb_readings import (
    CombState,
    Readings,
    nearest_events,
    steps_of,
)
from megalopta.sensor.calibrate.comb_regression import regressed
from megalopta.sensor.calibrate.curve import Curve
from megalopta.sensor.calibrate.level import Falls

_NEIGHBORS = np.arange(-1.0, 2.0)
_STAGES = 20
_FEW_EVENTS = 6.0
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
    curve: Curve
    slope_error: float
    """Standard error of its slope; infinite: the slope is not told, and taken for 0."""
    is_clear: bool
    """Whether no reading is between two teeth."""


def fit_comb(
    falls: Falls, exposure_s: Floats, step_v: Floats, offset_v: Floats, swing_v: float
) -> CombFit:
    """Fit the comb of each pixel from steps and offsets that are nearly right, each (P,) in V."""
    readings = Readings.of(falls, exposure_s)
    solution = np.stack([offset_v, np.zeros_like(step_v), step_v], axis=-1)
    start = CombState(solution, 0.1 * step_v, Curve(swing_v))
    state = _started(readings, start)
    is_clear = bool(np.median(state.noise / state.solution[:, 2]) < _CLEAR)
    if not is_clear:
        # readings between two teeth would bend the curve
        state = _started(readings, start._replace(may_slope=False))
    if is_clear:
        numbers = nearest_events(readings, state)[None]
        weights = np.ones_like(numbers)
    else:
        state, weights, numbers = _maximized(readings, falls, state)
    expected = (weights * numbers).sum(axis=0) * readings.times
    counts = np.zeros_like(falls.mean_v)
    np.add.at(counts, (readings.level, readings.pixel), expected)
    used = readings.sums((weights * (numbers >= readings.fewest)).sum(axis=0))
    covariance = covariance_of(readings, weights, numbers, state)
    return CombFit(
        state.solution,
        covariance,
        state.noise,
        counts,
        used,
        state.curve,
        state.slope_error,
        is_clear,
    )


def _started(readings: Readings, state: CombState) -> CombState:
    """Let readings join by events and exposure, each read with what the smaller ones say."""
    deepest = max(float((readings.fall / state.solution[readings.pixel, 2]).max()), _FEW_EVENTS)
    most = np.geomspace(_FEW_EVENTS, 2 * deepest, _STAGES)
    longest_s = np.geomspace(readings.exposure.min(), readings.exposure.max(), _STAGES)
    for events, exposure_s in zip(most, longest_s * (1 + 1e-9), strict=True):
        some = readings.at(readings.exposure <= exposure_s)
        for _ in range(_ROUNDS_OF_START):
            numbers = nearest_events(some, state)[None]
            # not by falls: of the last tooth only low readings would be left
            state = regressed(some, (numbers <= events).astype(float), numbers, state)
    return state


def _maximized(
    readings: Readings, falls: Falls, state: CombState
) -> tuple[CombState, Floats, Floats]:
    """Expectation and maximization in turn, until nothing moves."""
    for _ in range(_MOST_ROUNDS):
        weights, numbers = _posterior(readings, state, _means(readings, state, falls))
        before = state.solution
        state = regressed(readings, weights, numbers, state)
        scale = np.abs(state.solution).max(axis=0)
        if np.median(np.abs(state.solution - before) / scale) < _CONVERGED:
            break
    return state, *_posterior(readings, state, _means(readings, state, falls))


def _means(readings: Readings, state: CombState, falls: Falls) -> Floats:
    """Mean number of events of each level and pixel."""
    exposure = np.zeros(len(falls.mean_v))
    exposure[readings.level] = readings.exposure
    a, leak, step = state.solution.T
    steps = (falls.mean_v - a - leak * exposure[:, None]) / step
    return np.asarray(np.maximum(state.curve.numbers(steps, step), 1e-3))


def _posterior(readings: Readings, state: CombState, means: Floats) -> tuple[Floats, Floats]:
    """Chances of the numbers of events near each reading, and these, (3, E)."""
    step = state.solution[readings.pixel, 2]
    fallen = steps_of(readings, state)
    numbers = np.rint(state.curve.numbers(fallen, step)) + _NEIGHBORS[:, None]
    mean = means[readings.level, readings.pixel]
    width = (state.noise / state.solution[:, 2])[readings.pixel]
    chance = -0.5 * ((fallen - state.curve.steps(numbers, step)) / width) ** 2
    chance += numbers * np.log(mean) - gammaln(numbers.clip(0) + 1)
    chance = np.where(numbers < 0, -np.inf, chance)
    best = chance.max(axis=0)
    # a reading far above no count at all stands for none
    weights = np.exp(chance - np.where(np.isfinite(best), best, 0))
    lost = ~np.isfinite(best)
    weights[:, lost], numbers[:, lost] = 1, 0
    return weights / weights.sum(axis=0), numbers
