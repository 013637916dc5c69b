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
from numpy.typing import NDArray
from scipy.special import gammaln

from megalopta.arrays import Floats
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


_DETERMINED = 1e-9
_OF_MEDIAN = 1.2533
"""Standard error of a median over that of a mean."""
_SLOPE_TOLD = 0.02
"""Standard error of the slope from which on it is told."""


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


class _State(NamedTuple):
    """What is known so far."""

    solution: Floats
    noise: Floats
    curve: Curve
    slope_error: float = np.inf
    may_slope: bool = True


def fit_comb(
    falls: Falls, exposure_s: Floats, step_v: Floats, offset_v: Floats, swing_v: float
) -> CombFit:
    """Fit the comb of each pixel from steps and offsets that are nearly right, each (P,) in V."""
    entries = _Entries.of(falls, exposure_s)
    solution = np.stack([offset_v, np.zeros_like(step_v), step_v], axis=-1)
    start = _State(solution, 0.1 * step_v, Curve(swing_v))
    state = _started(entries, start)
    is_clear = bool(np.median(state.noise / state.solution[:, 2]) < _CLEAR)
    if not is_clear:
        # readings between two teeth would bend the curve
        state = _started(entries, start._replace(may_slope=False))
    if is_clear:
        numbers = _nearest(entries, state)[None]
        weights = np.ones_like(numbers)
    else:
        state, weights, numbers = _maximized(entries, falls, state)
    expected = (weights * numbers).sum(axis=0) * entries.times
    counts = np.zeros_like(falls.mean_v)
    np.add.at(counts, (entries.level, entries.pixel), expected)
    used = _sums(entries, (weights * (numbers >= entries.fewest)).sum(axis=0))
    covariance = _covariance(entries, weights, numbers, state)
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


def _started(entries: _Entries, state: _State) -> _State:
    """Let readings join by events and exposure, each read with what the smaller ones say."""
    deepest = max(float((entries.fall / state.solution[entries.pixel, 2]).max()), _FEW_EVENTS)
    most = np.geomspace(_FEW_EVENTS, 2 * deepest, _STAGES)
    longest_s = np.geomspace(entries.exposure.min(), entries.exposure.max(), _STAGES)
    for events, exposure_s in zip(most, longest_s * (1 + 1e-9), strict=True):
        some = entries.at(entries.exposure <= exposure_s)
        for _ in range(_ROUNDS_OF_START):
            numbers = _nearest(some, state)[None]
            # not by falls: of the last tooth only low readings would be left
            state = _regression(some, (numbers <= events).astype(float), numbers, state)
    return state


def _steps(entries: _Entries, state: _State) -> Floats:
    """Fall of each reading by events, in steps, (E,)."""
    a, leak, step = state.solution[entries.pixel].T
    return np.asarray((entries.fall - a - leak * entries.exposure) / step)


def _nearest(entries: _Entries, state: _State) -> Floats:
    """Number of events whose tooth is nearest to each reading, (E,)."""
    step = state.solution[entries.pixel, 2]
    return np.asarray(np.rint(state.curve.numbers(_steps(entries, state), step)).clip(0))


def _maximized(entries: _Entries, falls: Falls, state: _State) -> tuple[_State, Floats, Floats]:
    """Expectation and maximization in turn, until nothing moves."""
    for _ in range(_MOST_ROUNDS):
        weights, numbers = _posterior(entries, state, _means(entries, state, falls))
        before = state.solution
        state = _regression(entries, weights, numbers, state)
        scale = np.abs(state.solution).max(axis=0)
        if np.median(np.abs(state.solution - before) / scale) < _CONVERGED:
            break
    return state, *_posterior(entries, state, _means(entries, state, falls))


def _means(entries: _Entries, state: _State, falls: Falls) -> Floats:
    """Mean number of events of each level and pixel."""
    exposure = np.zeros(len(falls.mean_v))
    exposure[entries.level] = entries.exposure
    a, leak, step = state.solution.T
    steps = (falls.mean_v - a - leak * exposure[:, None]) / step
    return np.asarray(np.maximum(state.curve.numbers(steps, step), 1e-3))


def _posterior(entries: _Entries, state: _State, means: Floats) -> tuple[Floats, Floats]:
    """Chances of the numbers of events near each reading, and these, (3, E)."""
    step = state.solution[entries.pixel, 2]
    fallen = _steps(entries, state)
    numbers = np.rint(state.curve.numbers(fallen, step)) + _NEIGHBORS[:, None]
    mean = means[entries.level, entries.pixel]
    width = (state.noise / state.solution[:, 2])[entries.pixel]
    chance = -0.5 * ((fallen - state.curve.steps(numbers, step)) / width) ** 2
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


def _regression(entries: _Entries, weights: Floats, numbers: Floats, state: _State) -> _State:
    """Least squares of each pixel, residual noise, and the slope of all."""
    weights = weights * (numbers >= entries.fewest)
    columns = _columns(entries, numbers, state)[:3]
    normal, right = _normal(entries, weights, columns), _right(entries, weights, columns)
    scaled, scale = _scaled(normal)
    regular = np.linalg.cond(scaled) < 1e12
    found = np.einsum("pij,pj->pi", np.linalg.pinv(scaled, hermitian=True), right / scale) / scale
    squares = _sums(entries, (weights * _residual(entries, columns, found) ** 2).sum(axis=0))
    frames = np.maximum(_sums(entries, weights.sum(axis=0)) - 3, 1)
    state = state._replace(
        solution=np.where(regular[:, None], found, state.solution),
        noise=np.sqrt(np.maximum(squares / frames, 1e-18)),
    )
    return _sloped(entries, weights, numbers, state, regular) if state.may_slope else state


def _sloped(
    entries: _Entries,
    weights: Floats,
    numbers: Floats,
    state: _State,
    regular: NDArray[np.bool_],
) -> _State:
    """Move the slope by what residuals have in common with the bend of the curve."""
    columns = _columns(entries, numbers, state)
    information = _normal(entries, weights, columns) / state.noise[:, None, None] ** 2
    residual = _residual(entries, columns[:3], state.solution)
    score = _sums(entries, (weights * columns[3] * residual).sum(axis=0)) / state.noise**2
    influence = _influence(information)
    left = information[:, 3, 3] - np.einsum("pi,pi->p", information[:, 3, :3], influence)
    told = regular & (left > _DETERMINED * information[:, 3, 3])
    error = _OF_MEDIAN / np.sqrt(max(float(left[told].sum()), 1e-30))
    if error > _SLOPE_TOLD:
        return state
    before = state.curve.slope
    slope = float(np.clip(before + _median(score[told] / left[told], left[told]), -1, 1))
    # elsewhere the first step stays what it was
    first = np.zeros_like(influence)
    first[:, 2] = state.solution[:, 2] / (2 + slope)
    moved = np.where(told[:, None], influence, first)
    return state._replace(
        solution=state.solution - (slope - before) * moved,
        curve=state.curve._replace(slope=slope),
        slope_error=float(error),
    )


def _median(values: Floats, weights: Floats) -> float:
    """Of weighted values; a pixel whose teeth are miscounted does not move it."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order[np.searchsorted(total, total[-1] / 2)]])


def _influence(information: Floats) -> Floats:
    """How far the three parameters of a pixel move with the slope, (P, 3), with opposite sign."""
    scaled, scale = _scaled(information[:, :3, :3])
    inverse = np.linalg.pinv(scaled, hermitian=True)
    return np.asarray(np.einsum("pij,pj->pi", inverse, information[:, :3, 3] / scale) / scale)


def _columns(entries: _Entries, numbers: Floats, state: _State) -> list[Floats]:
    """Derivatives of readings by offset, leak, step and slope, each (…, E)."""
    step = state.solution[entries.pixel, 2]
    one = np.ones_like(numbers)
    steps, bend = state.curve.steps(numbers, step), state.curve.bend(numbers, step)
    return [one, one * entries.exposure, steps, step * bend]


def _residual(entries: _Entries, columns: list[Floats], solution: Floats) -> Floats:
    parts = zip(columns, solution[entries.pixel].T, strict=True)
    return np.asarray(entries.fall - sum(column * value for column, value in parts))


def _normal(entries: _Entries, weights: Floats, columns: list[Floats]) -> Floats:
    normal = np.empty((entries.pixels, len(columns), len(columns)))
    for row, one in enumerate(columns):
        for column, other in enumerate(columns[: row + 1]):
            product = _sums(entries, (weights * one * other).sum(axis=0))
            normal[:, row, column] = normal[:, column, row] = product
    return normal


def _right(entries: _Entries, weights: Floats, columns: list[Floats]) -> Floats:
    sums = [_sums(entries, (weights * each * entries.fall).sum(axis=0)) for each in columns]
    return np.stack(sums, axis=-1)


def _scaled(normal: Floats) -> tuple[Floats, Floats]:
    scale = np.sqrt(np.maximum(np.diagonal(normal, axis1=1, axis2=2), 1e-30))
    return normal / scale[:, :, None] / scale[:, None, :], scale


def _covariance(entries: _Entries, weights: Floats, numbers: Floats, state: _State) -> Floats:
    """Inverse of the observed information, and what the error of the slope adds."""
    used = weights * (numbers >= entries.fewest)
    columns = _columns(entries, numbers, state)
    complete = _normal(entries, used, columns) / state.noise[:, None, None] ** 2
    information = complete[:, :3, :3]
    if len(weights) > 1:
        pull = _residual(entries, columns[:3], state.solution) / state.noise[entries.pixel] ** 2
        information = information - _missing(entries, weights, columns[:3], pull * (used > 0))
    scaled, scale = _scaled(information)
    inverse = np.linalg.pinv(scaled, hermitian=True)
    covariance = inverse / scale[:, :, None] / scale[:, None, :]
    if np.isfinite(state.slope_error):
        moved = state.slope_error * _influence(complete)
        covariance = covariance + moved[:, :, None] * moved[:, None, :]
    return np.asarray(covariance)


def _missing(entries: _Entries, weights: Floats, columns: list[Floats], pull: Floats) -> Floats:
    """Information that is missing because numbers of events are not known, (P, 3, 3)."""
    scores = np.stack(columns) * pull
    mean = (weights * scores).sum(axis=1)
    missing = np.empty((entries.pixels, 3, 3))
    for row in range(3):
        for column in range(3):
            product = (weights * scores[row] * scores[column]).sum(0) - mean[row] * mean[column]
            missing[:, row, column] = _sums(entries, product)
    return missing
