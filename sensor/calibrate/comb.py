"""Fall of an output over the number of events, where the step changes over the swing.

Of the mean step s, slope σ and swing S, N events make, in steps,

    x = (1 + σ/2)·(1 − (1 − b)^N)/b       b = σ·s/S        N = log(1 − b·x/(1 + σ/2))/log(1 − b)

Source: `sensor/spad/analog.py`.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.special import gammaln

from megalopta.core.arrays import Floats
from megalopta.sensor.calibrate.level import Falls

_NUDGE = 1e-4


class Curve(NamedTuple):
    """How the step changes over the swing."""

    swing_v: float
    slope: float = 0.0
    """How much smaller it is at the bottom than at the top, relative."""

    def steps(self, numbers: Floats, step_v: Floats) -> Floats:
        """Fall after so many events, in steps; step_v (V) broadcasts."""
        if self.slope == 0:
            return numbers
        b = self.slope * step_v / self.swing_v
        return np.asarray(-(1 + self.slope / 2) / b * np.expm1(numbers * np.log1p(-b)))

    def numbers(self, steps: Floats, step_v: Floats) -> Floats:
        """Events after which it has fallen by so many steps, not rounded."""
        if self.slope == 0:
            return steps
        b = self.slope * step_v / self.swing_v
        left = np.maximum(1 - b * steps / (1 + self.slope / 2), 1e-9)
        return np.asarray(np.log(left) / np.log1p(-b))

    def bend(self, numbers: Floats, step_v: Floats) -> Floats:
        """Derivative of `steps` by the slope."""
        low, high = (
            self._replace(slope=self.slope + way * _NUDGE).steps(numbers, step_v) for way in (-1, 1)
        )
        return (high - low) / (2 * _NUDGE)


HIDDEN_AT = 0.36
"""Read noise over step above which the comb is too faint to fit."""
_TRIALS_PER_PEAK = 4


def comb_period(falls: Falls, around_v: Floats, within: float) -> tuple[Floats, Floats]:
    """Find the period of the readings of each pixel.

    Parameters
    ----------
    falls : Falls
    around_v : (P,)
        Where to look for the period (V).
    within : float
        How far around that, relative.

    Returns
    -------
    period_v : (P,)
        The period (V).
    noise : (P,)
        Read noise over it, as the height of the peak says.
    """
    period, noise = np.empty(around_v.size), np.empty(around_v.size)
    order = np.argsort(falls.pixel, kind="stable")
    ends = np.searchsorted(falls.pixel[order], np.arange(around_v.size + 1))
    for pixel, start, end in zip(range(around_v.size), ends[:-1], ends[1:], strict=True):
        own = order[start:end]
        period[pixel], noise[pixel] = _of_pixel(
            falls.fall_v[own],
            falls.times[own],
            np.flatnonzero(np.diff(falls.level[own], prepend=-1)),
            around_v[pixel],
            within,
        )
    return period, noise


def _of_pixel(
    fall_v: Floats, times: Floats, starts: NDArray[np.intp], around_v: float, within: float
) -> tuple[float, float]:
    if not starts.size or not around_v > 0:
        return np.nan, np.inf
    teeth = max(np.ptp(fall_v) / around_v, 4.0)
    trials = int(np.ceil(2 * within * teeth * _TRIALS_PER_PEAK)) + 3
    frequency = np.linspace(1 - within, 1 + within, trials) / around_v
    step = float(frequency[1] - frequency[0])
    phase = 2j * np.pi * (fall_v - fall_v.mean())
    wave, turn = times * np.exp(frequency[0] * phase), np.exp(step * phase)
    power = _powers(wave, turn, np.append(starts, fall_v.size), times, trials)
    best = int(np.clip(np.argmax(power), 1, trials - 2))
    left, middle, right = power[best - 1 : best + 2]
    bend = left - 2 * middle + right
    shift = 0.5 * (left - right) / bend if bend < 0 else 0.0
    height = min(max(float(middle), 1e-12), 1 - 1e-12)
    noise = float(np.sqrt(-np.log(height) / (4 * np.pi**2)))
    return 1 / float(frequency[best] + shift * step), noise


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _powers(
    wave: NDArray[np.complex128],
    turn: NDArray[np.complex128],
    ends: NDArray[np.intp],
    times: Floats,
    trials: int,
) -> Floats:
    """Mean over readings of the squared mean phases of levels; a turn from trial to trial."""
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


class Readings(NamedTuple):
    """How often each pixel showed each fall, (E,)."""

    level: NDArray[np.int64]
    pixel: NDArray[np.int64]
    fall: Floats
    times: Floats
    exposure: Floats
    pixels: int
    fewest: int
    """Readings of fewer events are left out of the line."""

    @classmethod
    def of(cls, falls: Falls, exposure_s: Floats) -> "Readings":
        """Of all levels, with the exposure of each."""
        return cls(
            falls.level,
            falls.pixel,
            falls.fall_v,
            falls.times,
            exposure_s[falls.level],
            falls.frames.shape[1],
            int(falls.is_cut),
        )

    def at(self, chosen: NDArray[np.bool_]) -> "Readings":
        """Some of the readings."""
        names = "level", "pixel", "fall", "times", "exposure"
        return self._replace(**{name: getattr(self, name)[chosen] for name in names})

    def sums(self, values: Floats) -> Floats:
        """Sum of values (E,) over the readings of each pixel, (P,)."""
        return np.bincount(self.pixel, self.times * values, self.pixels).astype(np.float64)


class CombState(NamedTuple):
    """What is known so far."""

    solution: Floats
    noise: Floats
    curve: Curve
    slope_error: float = np.inf
    may_slope: bool = True


def steps_of(readings: Readings, state: CombState) -> Floats:
    """Fall of each reading by events, in steps, (E,)."""
    a, leak, step = state.solution[readings.pixel].T
    return np.asarray((readings.fall - a - leak * readings.exposure) / step)


def nearest_events(readings: Readings, state: CombState) -> Floats:
    """Number of events whose tooth is nearest to each reading, (E,)."""
    step = state.solution[readings.pixel, 2]
    return np.asarray(np.rint(state.curve.numbers(steps_of(readings, state), step)).clip(0))


def columns_of(readings: Readings, numbers: Floats, state: CombState) -> list[Floats]:
    """Derivatives of readings by offset, leak, step and slope, each (…, E)."""
    step = state.solution[readings.pixel, 2]
    one = np.ones_like(numbers)
    steps, bend = state.curve.steps(numbers, step), state.curve.bend(numbers, step)
    return [one, one * readings.exposure, steps, step * bend]


def residuals(readings: Readings, columns: list[Floats], solution: Floats) -> Floats:
    """What of each fall the columns do not explain."""
    parts = zip(columns, solution[readings.pixel].T, strict=True)
    return np.asarray(readings.fall - sum(column * value for column, value in parts))


def normal_matrix(readings: Readings, weights: Floats, columns: list[Floats]) -> Floats:
    """Matrix of the normal equations of each pixel."""
    normal = np.empty((readings.pixels, len(columns), len(columns)))
    for row, one in enumerate(columns):
        for column, other in enumerate(columns[: row + 1]):
            product = readings.sums((weights * one * other).sum(axis=0))
            normal[:, row, column] = normal[:, column, row] = product
    return normal


def right_side(readings: Readings, weights: Floats, columns: list[Floats]) -> Floats:
    """Right side of the normal equations of each pixel."""
    sums = [readings.sums((weights * each * readings.fall).sum(axis=0)) for each in columns]
    return np.stack(sums, axis=-1)


def unit_diagonal(normal: Floats) -> tuple[Floats, Floats]:
    """Matrices with a diagonal of ones, and what their rows and columns were divided by."""
    scale = np.sqrt(np.maximum(np.diagonal(normal, axis1=1, axis2=2), 1e-30))
    return normal / scale[:, :, None] / scale[:, None, :], scale


def influence_of_slope(information: Floats) -> Floats:
    """How far the three parameters of a pixel move with the slope, (P, 3), with opposite sign."""
    unit, scale = unit_diagonal(information[:, :3, :3])
    inverse = np.linalg.pinv(unit, hermitian=True)
    return np.asarray(np.einsum("pij,pj->pi", inverse, information[:, :3, 3] / scale) / scale)


_DETERMINED = 1e-9
_OF_MEDIAN = 1.2533
"""Standard error of a median over that of a mean."""
_SLOPE_TOLD = 0.02
"""Standard error of the slope from which on it is told."""


def regressed(readings: Readings, weights: Floats, numbers: Floats, state: CombState) -> CombState:
    """Least squares of each pixel, residual noise, and the slope of all."""
    weights = weights * (numbers >= readings.fewest)
    columns = columns_of(readings, numbers, state)[:3]
    normal = normal_matrix(readings, weights, columns)
    right = right_side(readings, weights, columns)
    unit, scale = unit_diagonal(normal)
    regular = np.linalg.cond(unit) < 1e12
    found = np.einsum("pij,pj->pi", np.linalg.pinv(unit, hermitian=True), right / scale) / scale
    squares = readings.sums((weights * residuals(readings, columns, found) ** 2).sum(axis=0))
    frames = np.maximum(readings.sums(weights.sum(axis=0)) - 3, 1)
    state = state._replace(
        solution=np.where(regular[:, None], found, state.solution),
        noise=np.sqrt(np.maximum(squares / frames, 1e-18)),
    )
    return _sloped(readings, weights, numbers, state, regular) if state.may_slope else state


def _sloped(
    readings: Readings,
    weights: Floats,
    numbers: Floats,
    state: CombState,
    regular: NDArray[np.bool_],
) -> CombState:
    """Move the slope by what residuals have in common with the bend of the curve."""
    columns = columns_of(readings, numbers, state)
    information = normal_matrix(readings, weights, columns) / state.noise[:, None, None] ** 2
    residual = residuals(readings, columns[:3], state.solution)
    score = readings.sums((weights * columns[3] * residual).sum(axis=0)) / state.noise**2
    influence = influence_of_slope(information)
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


def covariance_of(readings: Readings, weights: Floats, numbers: Floats, state: CombState) -> Floats:
    """Inverse of the observed information, and what the error of the slope adds."""
    used = weights * (numbers >= readings.fewest)
    columns = columns_of(readings, numbers, state)
    complete = normal_matrix(readings, used, columns) / state.noise[:, None, None] ** 2
    information = complete[:, :3, :3]
    if len(weights) > 1:
        pull = residuals(readings, columns[:3], state.solution) / state.noise[readings.pixel] ** 2
        information = information - _missing(readings, weights, columns[:3], pull * (used > 0))
    unit, scale = unit_diagonal(information)
    inverse = np.linalg.pinv(unit, hermitian=True)
    covariance = inverse / scale[:, :, None] / scale[:, None, :]
    if np.isfinite(state.slope_error):
        moved = state.slope_error * influence_of_slope(complete)
        covariance = covariance + moved[:, :, None] * moved[:, None, :]
    return np.asarray(covariance)


def _missing(readings: Readings, weights: Floats, columns: list[Floats], pull: Floats) -> Floats:
    """Information that is missing because numbers of events are not known, (P, 3, 3)."""
    scores = np.stack(columns) * pull
    mean = (weights * scores).sum(axis=1)
    missing = np.empty((readings.pixels, 3, 3))
    for row in range(3):
        for column in range(3):
            product = (weights * scores[row] * scores[column]).sum(0) - mean[row] * mean[column]
            missing[:, row, column] = readings.sums(product)
    return missing


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
