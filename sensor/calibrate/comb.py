"""Comb fit: readings one step apart give offset, leak, step and read noise of each pixel.

**Period.** The mean phase |Σ exp(2πi·V/s)|/n over trial steps s is largest at the true step, where
read noise r reduces it to exp(−2π²·r²/s²). Each level has its own phase (leak), so squares are
summed. A parabola interpolates the maximum between trials.

**Fit**, by maximum likelihood. A reading is the voltage drop of the output

    y = a + l·T + s·x(N) + r·z       z normal; N events, Poisson at the level's own mean

with unknown N. Where the step changes over the swing S, with mean step s and slope σ, N events
cause a drop of, in steps (`sensor/spad/counters.py`),

    x = (1 + σ/2)·(1 − (1 − b)^N)/b       b = σ·s/S        N = log(1 − b·x/(1 + σ/2))/log(1 − b)

Expectation–maximization: given the four parameters, each reading has a posterior over the three
nearest N; given these, (a, l, s) are a weighted least-squares line and r² its residual. Intervals
use the observed information: that of complete data less what is missing because N is unknown (T. A.
Louis, J. R. Stat. Soc. B 44, 226, 1982). With a clear comb this is ordinary regression on event
numbers.

One slope of the step holds for the whole array: the projection of all pixels' residuals on the bend
of the curve (Gauss–Newton). If they do not determine it, it is 0.

Initial values: steps from `comb_period`, offsets from dark means at short exposures. Readings are
then added in order of events and exposure; leak and slope so far assign them to peaks.

Source: PCH-EM, Hendrickson and Haefner, arXiv 2302.00090 and 2403.04498, which has one level and no
leak, and also starts from the empirical characteristic function.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from megalopta.core.arrays import Floats, Mask
from megalopta.core.compiling import compiled
from megalopta.sensor.calibrate.level import Falls

HIDDEN_AT = 0.36
"""Read noise over step above which the comb is too faint to fit."""
_CLEAR = 0.12
"""Read noise over step below which no reading is between two peaks."""
_TRIALS_PER_PEAK = 4

_NUDGE = 1e-4
_NEIGHBORS = np.arange(-1.0, 2.0)
_STAGES, _ROUNDS_OF_START = 20, 2
_FEW_EVENTS = 6.0
_MOST_ROUNDS, _CONVERGED = 30, 1e-8
_DETERMINED = 1e-9
_OF_MEDIAN = 1.2533
"""Standard error of a median over that of a mean."""
_LARGEST_SLOPE_ERROR = 0.02
"""Standard error of the slope above which it is taken as 0."""


class Curve(NamedTuple):
    """Voltage drop over the number of events, where the step changes over the swing."""

    swing_v: float
    slope: float = 0.0
    """Relative decrease of the step from the top to the bottom of the swing."""

    def steps(self, numbers: Floats, step_v: Floats) -> Floats:
        """Return the drop after a number of events, in steps; step_v (V) broadcasts."""
        if self.slope == 0:
            return numbers
        b = self.slope * step_v / self.swing_v
        return np.asarray(-(1 + self.slope / 2) / b * np.expm1(numbers * np.log1p(-b)))

    def numbers(self, steps: Floats, step_v: Floats) -> Floats:
        """Return the number of events, not rounded, after which it has dropped by so many steps."""
        if self.slope == 0:
            return steps
        b = self.slope * step_v / self.swing_v
        left = np.maximum(1 - b * steps / (1 + self.slope / 2), 1e-9)
        return np.asarray(np.log(left) / np.log1p(-b))

    def bend(self, numbers: Floats, step_v: Floats) -> Floats:
        """Return the derivative of `steps` with respect to the slope."""
        low, high = (
            self._replace(slope=self.slope + way * _NUDGE).steps(numbers, step_v) for way in (-1, 1)
        )
        return (high - low) / (2 * _NUDGE)


class CombFit(NamedTuple):
    """Parameters of each pixel (P, 3): drop without counts V, leak V/s, step V; and noise."""

    solution: Floats
    covariance: Floats
    """(P, 3, 3)"""
    noise_v: Floats
    """(P,) read noise and rounding together."""
    counts: Floats
    """(levels, P) sum of events over all frames; 0 where the level is not used."""
    readings: Floats
    """(P,) number of readings behind the noise."""
    curve: Curve
    slope_error: float
    """Standard error of the slope; infinite if it is not determined and taken as 0."""
    is_clear: bool
    """True if no reading is between two peaks."""


def comb_period(falls: Falls, around_v: Floats, within: float) -> tuple[Floats, Floats]:
    """Return the period of the readings of each pixel, (P,) in V, and read noise over it, (P,).

    The noise follows from the height of the peak. Periods are searched around `around_v`, (P,) in
    V, within the relative range `within`.
    """
    order = np.argsort(falls.pixel, kind="stable")
    ends = np.searchsorted(falls.pixel[order], np.arange(around_v.size + 1))
    periods, noises = np.full(around_v.size, np.nan), np.full(around_v.size, np.inf)
    for pixel, typical_v in enumerate(around_v):
        entries = order[ends[pixel] : ends[pixel + 1]]
        if not entries.size or not typical_v > 0:
            continue
        fall_v, times = falls.fall_v[entries], falls.times[entries]
        starts = np.flatnonzero(np.diff(falls.level[entries], prepend=-1))
        peaks = max(np.ptp(fall_v) / typical_v, 4.0)
        trials = int(np.ceil(2 * within * peaks * _TRIALS_PER_PEAK)) + 3
        frequency = np.linspace(1 - within, 1 + within, trials) / typical_v
        step = float(frequency[1] - frequency[0])
        phase = 2j * np.pi * (fall_v - fall_v.mean())
        wave, turn = times * np.exp(frequency[0] * phase), np.exp(step * phase)
        power = _powers(wave, turn, np.append(starts, fall_v.size), times, trials)
        best = int(np.clip(np.argmax(power), 1, trials - 2))
        left, middle, right = power[best - 1 : best + 2]
        bend = left - 2 * middle + right
        shift = 0.5 * (left - right) / bend if bend < 0 else 0.0
        height = min(max(float(middle), 1e-12), 1 - 1e-12)
        noises[pixel] = float(np.sqrt(-np.log(height) / (4 * np.pi**2)))
        periods[pixel] = 1 / float(frequency[best] + shift * step)
    return periods, noises


@compiled
def _powers(
    wave: NDArray[np.complex128],
    turn: NDArray[np.complex128],
    ends: NDArray[np.intp],
    times: Floats,
    trials: int,
) -> Floats:
    """Mean over readings of the squared mean phases of levels, one turn per trial."""
    power = np.zeros(trials)
    for at in range(len(ends) - 1):
        own = slice(ends[at], ends[at + 1])
        total = times[own].sum()
        here, by = wave[own].copy(), turn[own]
        for trial in range(trials):
            real, imaginary = 0.0, 0.0
            for reading in range(here.size):
                real += here[reading].real
                imaginary += here[reading].imag
                here[reading] *= by[reading]
            power[trial] += (real**2 + imaginary**2) / total
    power /= times.sum()
    return power


class _Readings(NamedTuple):
    """Voltage drops of pixels, and how often each was seen, (E,).

    Weights and event numbers below are (k, E): k candidate numbers for each reading.
    """

    level: NDArray[np.int64]
    pixel: NDArray[np.int64]
    fall: Floats
    times: Floats
    exposure: Floats
    means: Floats
    """(levels, P) mean drops"""
    fewest: int
    """Readings of fewer events are excluded from the line."""

    def at(self, chosen: Mask) -> "_Readings":
        return self._replace(**{name: getattr(self, name)[chosen] for name in self._fields[:5]})

    def sums(self, values: Floats) -> Floats:
        """Sums of values (k, E) over the readings of each pixel, (P,)."""
        weights = self.times * values.sum(axis=0)
        return np.bincount(self.pixel, weights, self.means.shape[1]).astype(np.float64)

    def normal_matrix(self, weights: Floats, columns: list[Floats]) -> Floats:
        """Matrix of the normal equations of each pixel."""
        normal = np.empty((self.means.shape[1], len(columns), len(columns)))
        for row, one in enumerate(columns):
            for column, other in enumerate(columns[: row + 1]):
                product = self.sums(weights * one * other)
                normal[:, row, column] = normal[:, column, row] = product
        return normal


class _State(NamedTuple):
    """Estimates so far."""

    solution: Floats
    noise: Floats
    curve: Curve
    slope_error: float = np.inf
    may_slope: bool = True

    def steps(self, readings: _Readings) -> Floats:
        """Drop of each reading due to events, in steps, (E,)."""
        a, leak, step = self.solution[readings.pixel].T
        return np.asarray((readings.fall - a - leak * readings.exposure) / step)

    def nearest(self, readings: _Readings) -> Floats:
        """Number of events of the peak nearest to each reading, (1, E)."""
        step = self.solution[readings.pixel, 2]
        return np.rint(self.curve.numbers(self.steps(readings), step)).clip(0)[np.newaxis]

    def columns(self, readings: _Readings, numbers: Floats) -> list[Floats]:
        """Derivatives of readings with respect to offset, leak, step and slope, each (k, E)."""
        step = self.solution[readings.pixel, 2]
        one = np.ones_like(numbers)
        steps, bend = self.curve.steps(numbers, step), self.curve.bend(numbers, step)
        return [one, one * readings.exposure, steps, step * bend]

    def residuals(self, readings: _Readings, columns: list[Floats]) -> Floats:
        """Difference of each drop from the line through the first three columns."""
        parts = zip(columns[:3], self.solution[readings.pixel].T, strict=True)
        return np.asarray(readings.fall - sum(column * value for column, value in parts))


def fit_comb(falls: Falls, step_v: Floats, offset_v: Floats, swing_v: float) -> CombFit:
    """Fit the comb of each pixel from approximate steps and offsets, each (P,) in V."""
    readings = _Readings(
        falls.level,
        falls.pixel,
        falls.fall_v,
        falls.times,
        falls.exposure_s[falls.level],
        falls.mean_v,
        int(falls.is_cut),
    )
    solution = np.stack([offset_v, np.zeros_like(step_v), step_v], axis=-1)
    start = _State(solution, 0.1 * step_v, Curve(swing_v))
    state = _started(readings, start)
    is_clear = bool(np.median(state.noise / state.solution[:, 2]) < _CLEAR)
    if is_clear:
        weights = np.ones(len(readings.pixel))
        # peaks counted wrongly from some depth on also fit a slope, with more noise
        other = _started(readings, start._replace(may_slope=False))._replace(may_slope=True)
        for _ in range(_ROUNDS_OF_START):
            other = _regressed(readings, weights, other.nearest(readings), other)
        state = min(state, other, key=lambda fitted: float(np.median(fitted.noise)))
        numbers = state.nearest(readings)
    else:
        # readings between two peaks would bend the curve
        state = _started(readings, start._replace(may_slope=False))
        for _ in range(_MOST_ROUNDS):
            before = state.solution
            state = _regressed(readings, *_posterior(readings, state), state)
            scale = np.abs(state.solution).max(axis=0)
            if np.median(np.abs(state.solution - before) / scale) < _CONVERGED:
                break
        weights, numbers = _posterior(readings, state)
    counts = np.zeros_like(falls.mean_v)
    expected = (weights * numbers).sum(axis=0) * readings.times
    np.add.at(counts, (readings.level, readings.pixel), expected)
    used = readings.sums(weights * (numbers >= readings.fewest))
    covariance = _covariance(readings, weights, numbers, state)
    return CombFit(
        state.solution, covariance, state.noise, counts, used, state.curve, state.slope_error,
        is_clear,
    )  # fmt: skip


def _started(readings: _Readings, state: _State) -> _State:
    """Add readings by events and exposure, each assigned with the fit of the smaller ones."""
    deepest = max(float((readings.fall / state.solution[readings.pixel, 2]).max()), _FEW_EVENTS)
    most = np.geomspace(_FEW_EVENTS, 2 * deepest, _STAGES)
    longest_s = np.geomspace(readings.exposure.min(), readings.exposure.max(), _STAGES)
    for events, exposure_s in zip(most, longest_s * (1 + 1e-9), strict=True):
        some = readings.at(readings.exposure <= exposure_s)
        for _ in range(_ROUNDS_OF_START):
            numbers = state.nearest(some)
            # not by drops: of the last peak only low readings would remain
            state = _regressed(some, (numbers <= events).astype(float), numbers, state)
    return state


def _posterior(readings: _Readings, state: _State) -> tuple[Floats, Floats]:
    """Probabilities of the event numbers near each reading, and these numbers, (3, E)."""
    step = state.solution[readings.pixel, 2]
    fallen = state.steps(readings)
    numbers = np.rint(state.curve.numbers(fallen, step)) + _NEIGHBORS[:, None]
    # mean number of events of each level and pixel
    exposure = np.zeros(len(readings.means))
    exposure[readings.level] = readings.exposure
    offset_v, leak_v_s, step_v = state.solution.T
    steps = (readings.means - offset_v - leak_v_s * exposure[:, None]) / step_v
    mean_events = np.maximum(state.curve.numbers(steps, step_v), 1e-3)
    mean = mean_events[readings.level, readings.pixel]
    width = (state.noise / state.solution[:, 2])[readings.pixel]
    logs = -0.5 * ((fallen - state.curve.steps(numbers, step)) / width) ** 2
    logs += numbers * np.log(mean) - gammaln(numbers.clip(0) + 1)
    logs = np.where(numbers < 0, -np.inf, logs)
    best = logs.max(axis=0)
    # a reading far above the level of no counts has no event number
    lost = ~np.isfinite(best)
    weights = np.exp(logs - np.where(lost, 0, best))
    weights[:, lost], numbers[:, lost] = 1, 0
    return weights / weights.sum(axis=0), numbers


def _regressed(readings: _Readings, weights: Floats, numbers: Floats, state: _State) -> _State:
    """Least squares of each pixel, residual noise, and the common slope."""
    weights = weights * (numbers >= readings.fewest)
    columns = state.columns(readings, numbers)[:3]
    normal = readings.normal_matrix(weights, columns)
    right = np.stack([readings.sums(weights * each * readings.fall) for each in columns], axis=-1)
    regular = np.linalg.cond(_unit_diagonal(normal)[0]) < 1e12
    found = state._replace(solution=_solved(normal, right))
    squares = readings.sums(weights * found.residuals(readings, columns) ** 2)
    frames = np.maximum(readings.sums(weights) - 3, 1)
    state = state._replace(
        solution=np.where(regular[:, None], found.solution, state.solution),
        noise=np.sqrt(np.maximum(squares / frames, 1e-18)),
    )
    return _sloped(readings, weights, numbers, state, regular) if state.may_slope else state


def _sloped(
    readings: _Readings, weights: Floats, numbers: Floats, state: _State, regular: Mask
) -> _State:
    """Move the slope by the projection of residuals on the bend of the curve."""
    columns = state.columns(readings, numbers)
    information = readings.normal_matrix(weights, columns) / state.noise[:, None, None] ** 2
    score = readings.sums(weights * columns[3] * state.residuals(readings, columns))
    score = score / state.noise**2
    influence = _solved(information[:, :3, :3], information[:, :3, 3])
    left = information[:, 3, 3] - np.einsum("pi,pi->p", information[:, 3, :3], influence)
    known = regular & (left > _DETERMINED * information[:, 3, 3])
    error = _OF_MEDIAN / np.sqrt(max(float(left[known].sum()), 1e-30))
    if error > _LARGEST_SLOPE_ERROR:
        return state
    before = state.curve.slope
    # weighted median, robust against pixels with miscounted peaks
    changes, weight = score[known] / left[known], left[known]
    order = np.argsort(changes)
    total = np.cumsum(weight[order])
    change = float(changes[order[np.searchsorted(total, total[-1] / 2)]])
    slope = float(np.clip(before + change, -1, 1))
    # elsewhere the first step is kept
    first = np.zeros_like(influence)
    first[:, 2] = state.solution[:, 2] / (2 + slope)
    moved = np.where(known[:, None], influence, first)
    return state._replace(
        solution=state.solution - (slope - before) * moved,
        curve=state.curve._replace(slope=slope),
        slope_error=float(error),
    )


def _covariance(readings: _Readings, weights: Floats, numbers: Floats, state: _State) -> Floats:
    """Inverse of the observed information plus the share of the slope's error, (P, 3, 3)."""
    used = weights * (numbers >= readings.fewest)
    columns = state.columns(readings, numbers)
    complete = readings.normal_matrix(used, columns) / state.noise[:, None, None] ** 2
    information = complete[:, :3, :3]
    if len(weights) > 1:
        pull = state.residuals(readings, columns) / state.noise[readings.pixel] ** 2
        # less the information that is missing because event numbers are unknown
        line_columns = columns[:3]
        pulls = pull * (used > 0)
        scores = np.stack(line_columns) * pulls
        mean = (weights * scores).sum(axis=1)
        missing = np.empty((readings.means.shape[1], 3, 3))
        for first, second in np.ndindex(3, 3):
            product = (weights * scores[first] * scores[second]).sum(0) - mean[first] * mean[second]
            missing[:, first, second] = readings.sums(product[np.newaxis])
        information = information - missing
    unit, scale = _unit_diagonal(information)
    inverse = np.linalg.pinv(unit, hermitian=True)
    covariance = inverse / scale[:, :, None] / scale[:, None, :]
    if np.isfinite(state.slope_error):
        moved = state.slope_error * _solved(complete[:, :3, :3], complete[:, :3, 3])
        covariance = covariance + moved[:, :, None] * moved[:, None, :]
    return np.asarray(covariance)


def _unit_diagonal(normal: Floats) -> tuple[Floats, Floats]:
    """Matrices scaled to a unit diagonal, and the divisors of their rows and columns."""
    scale = np.sqrt(np.maximum(np.diagonal(normal, axis1=1, axis2=2), 1e-30))
    return normal / scale[:, :, None] / scale[:, None, :], scale


def _solved(normal: Floats, right: Floats) -> Floats:
    """Solutions (P, 3) of the normal equations of each pixel."""
    unit, scale = _unit_diagonal(normal)
    inverse = np.linalg.pinv(unit, hermitian=True)
    return np.asarray(np.einsum("pij,pj->pi", inverse, right / scale) / scale)
