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

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled
from megalopta.sensor.calibrate.level import Drops, inverses, unit_diagonal

HIDDEN_AT = 0.36
"""Read noise over step above which the comb is too faint to fit."""

_NUDGE = 1e-4
_STAGES, _ROUNDS_OF_START = 20, 2
_FEW_EVENTS = 6.0


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
    squares: Floats
    """(levels, P) sum of their squares."""
    readings: Floats
    """(P,) number of readings behind the noise."""
    curve: Curve
    slope_error: float
    """Standard error of the slope; infinite if it is not determined and taken as 0."""


def comb_period(drops: Drops, typical_v: float, within: float) -> tuple[Floats, Floats]:
    """Return the period of the readings of each pixel, (P,) in V, and read noise over it, (P,).

    The noise follows from the height of the peak. Periods are searched around a typical one, within
    this relative range.
    """
    pixels = drops.mean_v.shape[1]
    order = np.argsort(drops.pixel, kind="stable")
    ends = np.searchsorted(drops.pixel[order], np.arange(pixels + 1))
    periods_v, noises = np.full(pixels, np.nan), np.full(pixels, np.inf)
    for pixel in range(pixels if typical_v > 0 else 0):
        entries = order[ends[pixel] : ends[pixel + 1]]
        if not entries.size:
            continue
        drop_v, times = drops.drop_v[entries], drops.times[entries]
        starts = np.flatnonzero(np.diff(drops.level[entries], prepend=-1))
        peaks = max(np.ptp(drop_v) / typical_v, 4.0)
        trials = int(np.ceil(8 * within * peaks)) + 3  # four per peak
        frequency = np.linspace(1 - within, 1 + within, trials) / typical_v
        step = float(frequency[1] - frequency[0])
        phase = 2j * np.pi * (drop_v - drop_v.mean())
        wave, turn = times * np.exp(frequency[0] * phase), np.exp(step * phase)
        power = _powers(wave, turn, np.append(starts, drop_v.size), times, trials)
        best = int(np.clip(np.argmax(power), 1, trials - 2))
        left, middle, right = power[best - 1 : best + 2]
        bend = left - 2 * middle + right
        shift = 0.5 * (left - right) / bend if bend < 0 else 0.0
        height = min(max(float(middle), 1e-12), 1 - 1e-12)
        noises[pixel] = float(np.sqrt(-np.log(height) / (4 * np.pi**2)))
        periods_v[pixel] = 1 / float(frequency[best] + shift * step)
    return periods_v, noises


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
        level = slice(ends[at], ends[at + 1])
        total = times[level].sum()
        phasor, by = wave[level].copy(), turn[level]
        for trial in range(trials):
            real, imaginary = 0.0, 0.0
            for reading in range(phasor.size):
                real += phasor[reading].real
                imaginary += phasor[reading].imag
                phasor[reading] *= by[reading]
            power[trial] += (real**2 + imaginary**2) / total
    power /= times.sum()
    return power


class _State(NamedTuple):
    """Estimates so far; events of readings are (k, E): k candidate numbers for each."""

    solution: Floats
    """(P, 3) offset, leak and step"""
    noise: Floats
    curve: Curve
    slope_error: float = np.inf
    may_slope: bool = True

    def steps(self, drops: Drops) -> Floats:
        """Drop of each reading due to events, in steps, (E,)."""
        offset_v, leak_v_s, step_v = self.solution[drops.pixel].T
        return np.asarray((drops.drop_v - offset_v - leak_v_s * drops.entry_exposure_s) / step_v)

    def nearest(self, drops: Drops) -> Floats:
        """Number of events of the peak nearest to each reading, (1, E)."""
        step_v = self.solution[drops.pixel, 2]
        return np.rint(self.curve.numbers(self.steps(drops), step_v)).clip(0)[np.newaxis]

    def columns(self, drops: Drops, numbers: Floats) -> list[Floats]:
        """Derivatives of readings with respect to offset, leak, step and slope, each (k, E)."""
        step_v, ones = self.solution[drops.pixel, 2], np.ones_like(numbers)
        steps, bend = self.curve.steps(numbers, step_v), self.curve.bend(numbers, step_v)
        return [ones, ones * drops.entry_exposure_s, steps, step_v * bend]

    def residuals(self, drops: Drops, columns: list[Floats]) -> Floats:
        """Difference of each drop from the line through the first three columns."""
        parts = zip(columns[:3], self.solution[drops.pixel].T, strict=True)
        return np.asarray(drops.drop_v - sum(column * value for column, value in parts))


def fit_comb(drops: Drops, step_v: Floats, offset_v: Floats, swing_v: float) -> CombFit:
    """Fit the comb of each pixel from approximate steps and offsets, each (P,) in V."""
    solution = np.stack([offset_v, np.zeros_like(step_v), step_v], axis=-1)
    start = _State(solution, 0.1 * step_v, Curve(swing_v))
    state = _started(drops, start)
    # readings between two peaks would bend the curve
    straight = _started(drops, start._replace(may_slope=False))
    is_clear = bool(np.median(state.noise / state.solution[:, 2]) < 0.12)  # no reading between
    if is_clear:
        weights = np.ones(len(drops.pixel))
        # peaks counted wrongly from some depth on also fit a slope, with more noise
        straight = straight._replace(may_slope=True)
        for _ in range(_ROUNDS_OF_START):
            straight = _regressed(drops, weights, straight.nearest(drops), straight)
        state = min(state, straight, key=lambda fitted: float(np.median(fitted.noise)))
        numbers = state.nearest(drops)
    else:
        state = straight
        for _ in range(30):
            before = state.solution
            state = _regressed(drops, *_posterior(drops, state), state)
            scale = np.abs(state.solution).max(axis=0)
            if np.median(np.abs(state.solution - before) / scale) < 1e-8:
                break
        weights, numbers = _posterior(drops, state)
    counts, squares = np.zeros((2, *drops.mean_v.shape))
    for power, sums in ((1, counts), (2, squares)):
        expected = (weights * numbers**power).sum(axis=0) * drops.times
        np.add.at(sums, (drops.level, drops.pixel), expected)
    used = weights * (numbers >= drops.is_cut)
    # the inverse of the observed information plus the share of the slope's error
    columns = state.columns(drops, numbers)
    complete = drops.normal_matrix(used, columns) / state.noise[:, None, None] ** 2
    information = complete[:, :3, :3]
    if len(weights) > 1:
        # less the information that is missing because event numbers are unknown
        pulls = state.residuals(drops, columns) / state.noise[drops.pixel] ** 2 * (used > 0)
        scores = np.stack(columns[:3]) * pulls
        mean = (weights * scores).sum(axis=1)
        missing = np.empty_like(information)
        for row, column in np.ndindex(3, 3):
            product = (weights * scores[row] * scores[column]).sum(axis=0)
            product -= mean[row] * mean[column]
            missing[:, row, column] = drops.sums(product[np.newaxis])
        information = information - missing
    covariance = inverses(information)
    if np.isfinite(state.slope_error):
        moved = state.slope_error * _solved(complete[:, :3, :3], complete[:, :3, 3])
        covariance = covariance + moved[:, :, None] * moved[:, None, :]
    return CombFit(
        state.solution, covariance, state.noise, counts, squares, drops.sums(used), state.curve,
        state.slope_error,
    )  # fmt: skip


def _started(drops: Drops, state: _State) -> _State:
    """Add readings by events and exposure, each assigned with the fit of the smaller ones."""
    exposure_s = drops.entry_exposure_s
    deepest = max(float((drops.drop_v / state.solution[drops.pixel, 2]).max()), _FEW_EVENTS)
    most = np.geomspace(_FEW_EVENTS, 2 * deepest, _STAGES)
    longest_s = np.geomspace(exposure_s.min(), exposure_s.max(), _STAGES) * (1 + 1e-9)
    for events, longest in zip(most, longest_s, strict=True):
        short = drops.at(exposure_s <= longest)
        for _ in range(_ROUNDS_OF_START):
            numbers = state.nearest(short)
            # not by drops: of the last peak only low readings would remain
            state = _regressed(short, (numbers <= events).astype(float), numbers, state)
    return state


def _posterior(drops: Drops, state: _State) -> tuple[Floats, Floats]:
    """Probabilities of the event numbers near each reading, and these numbers, (3, E)."""
    step_v, steps = state.solution[drops.pixel, 2], state.steps(drops)
    numbers = np.rint(state.curve.numbers(steps, step_v)) + np.array([[-1.0], [0.0], [1.0]])
    # mean number of events of each level and pixel
    offset_v, leak_v_s, steps_v = state.solution.T
    mean_steps = (drops.mean_v - offset_v - leak_v_s * drops.exposure_s[:, None]) / steps_v
    mean = np.maximum(state.curve.numbers(mean_steps, steps_v), 1e-3)
    width = (state.noise / steps_v)[drops.pixel]
    logs = -0.5 * ((steps - state.curve.steps(numbers, step_v)) / width) ** 2
    logs += numbers * np.log(mean[drops.level, drops.pixel]) - gammaln(numbers.clip(0) + 1)
    logs = np.where(numbers < 0, -np.inf, logs)
    best = logs.max(axis=0)
    # a reading far above the level of no counts has no event number
    lost = ~np.isfinite(best)
    weights = np.exp(logs - np.where(lost, 0, best))
    weights[:, lost], numbers[:, lost] = 1, 0
    return weights / weights.sum(axis=0), numbers


def _regressed(drops: Drops, weights: Floats, numbers: Floats, state: _State) -> _State:
    """Least squares of each pixel, residual noise, and the common slope."""
    weights = weights * (numbers >= drops.is_cut)
    columns = state.columns(drops, numbers)
    line = columns[:3]
    normal = drops.normal_matrix(weights, line)
    right = np.stack([drops.sums(weights * part * drops.drop_v) for part in line], axis=-1)
    regular = np.linalg.cond(unit_diagonal(normal)[0]) < 1e12
    fitted = state._replace(solution=_solved(normal, right))
    squares = drops.sums(weights * fitted.residuals(drops, line) ** 2)
    frames = np.maximum(drops.sums(weights) - 3, 1)
    state = state._replace(
        solution=np.where(regular[:, None], fitted.solution, state.solution),
        noise=np.sqrt(np.maximum(squares / frames, 1e-18)),
    )
    if not state.may_slope:
        return state
    # move the slope by the projection of residuals on the bend of the curve
    columns = state.columns(drops, numbers)
    information = drops.normal_matrix(weights, columns) / state.noise[:, None, None] ** 2
    score = drops.sums(weights * columns[3] * state.residuals(drops, columns))
    influence = _solved(information[:, :3, :3], information[:, :3, 3])
    left = information[:, 3, 3] - np.einsum("pi,pi->p", information[:, 3, :3], influence)
    known = regular & (left > 1e-9 * information[:, 3, 3])
    # of a weighted median, 1.2533 times that of a mean
    error = 1.2533 / np.sqrt(max(float(left[known].sum()), 1e-30))
    # it is not determined, and taken as 0
    if error > 0.02:
        return state
    # weighted median, robust against pixels with miscounted peaks
    changes, weight = (score / state.noise**2)[known] / left[known], left[known]
    order = np.argsort(changes)
    total = np.cumsum(weight[order])
    change = float(changes[order[np.searchsorted(total, total[-1] / 2)]])
    slope = float(np.clip(state.curve.slope + change, -1, 1))
    # elsewhere the first step is kept
    first = np.zeros_like(influence)
    first[:, 2] = state.solution[:, 2] / (2 + slope)
    moved = np.where(known[:, None], influence, first)
    return state._replace(
        solution=state.solution - (slope - state.curve.slope) * moved,
        curve=state.curve._replace(slope=slope),
        slope_error=float(error),
    )


def _solved(normal: Floats, right: Floats) -> Floats:
    """Solutions (P, 3) of the normal equations of each pixel."""
    return np.asarray(np.einsum("pij,pj->pi", inverses(normal), right))
