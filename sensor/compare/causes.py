"""Global parameters that explain how two recordings differ, or none.

**Features** of every level, means over its good pixels:

    M    mean counts            V    variance of counts in time
    C    covariance of a pixel with its right and lower neighbors
    K    |mean of exp(2πi·x)|², the clearness of the comb, for codes of few counts

Their scatter over few blocks of frames gives their covariance, so that Hotelling's T² has the
distribution F, not χ²: covariances are multiplied by what gives χ² the chance of T². Errors of the
calibration and common fluctuations are added.

**Choice.** A difference is stated where its chance is below `FALSE_ALARMS` even if the model errs
by `_ERRORS`. The fewest causes, at most two, whose χ² has a chance above `REFUTED` explain it, and
those of as many that do nearly as well are stated. Predicted changes are allowed an error of
`MODEL_ERROR`, those of covariances, which are first-order, of three times as much.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.stats import chi2, f, norm

from megalopta.core.arrays import Floats, Ints, Mask
from megalopta.sensor.calibrate.level import Level, inverses
from megalopta.sensor.change import changed
from megalopta.sensor.compare.left import left_of_all, strength
from megalopta.sensor.compare.residual import Residual
from megalopta.sensor.compare.two_sample import BLOCKS, Difference
from megalopta.sensor.effects.crosstalk import neighborhoods
from megalopta.sensor.spad.counters import AnalogCounter

REFUTED = 1e-3
"""Chance of its χ² below which an explanation is refuted."""
FALSE_ALARMS = 2e-3
"""Chance of a χ² above which no difference is seen."""
MODEL_ERROR = 0.04
"""Relative error of a predicted change."""
_EQUAL, _AS_GOOD = 2.0, 9.0
"""Differences of χ² of explanations that are equals, and of those that are nearly as good"""
_ERRORS = {"M": 2e-3, "V": 5e-3, "K": 1e-2, "C": 1e-3}
"""Errors of features that are forgiven to the model: relative, of C to the mean."""
_95, _90 = 1.959964, 1.644854
_SMALLEST = 1e-10
"""Smallest eigenvalue of a covariance at a unit diagonal that is not taken as 0"""


class Features(NamedTuple):
    """Features of all levels, in one vector."""

    values: Floats
    """(F,)"""
    covariance: Floats
    """(F, F), of one frame"""
    frames: Ints
    """(F,)"""
    level: Ints
    """(F,) number of the level"""
    kind: NDArray[np.str_]
    """(F,) one of M, V, C, K"""


def features(
    recordings: Sequence[Level], good: Sequence[Mask], has_comb: Sequence[bool]
) -> Features:
    """Return the features of the good pixels of the recordings of all levels."""
    values, covariances, of_level = [np.zeros(0)], [], []
    for number, (level, pixels) in enumerate(zip(recordings, good, strict=True)):
        if pixels.sum() < 2:
            continue
        n, kinds = len(level.readings), "MVCK" if has_comb[number] else "MVC"
        edges = np.linspace(0, n, BLOCKS + 1).astype(int)
        frames = (np.asarray(level.signal[start:end], np.float32) for start, end in pairwise(edges))
        blocks = np.array([_of_frames(part, pixels, has_comb[number]) for part in frames])
        values.append(blocks.mean(axis=0))
        covariances.append(np.cov(blocks.T) * n / BLOCKS)
        of_level += [(n, number, kind) for kind in kinds]
    columns = map(np.array, zip(*of_level, strict=True))
    return Features(np.concatenate(values), block_diag(*covariances), *columns)


def _of_frames(signal: NDArray[Any], good: Mask, has_comb: bool) -> list[float]:
    n = len(signal)
    mean = signal.mean(axis=0, dtype=np.float64)
    noise = np.where(good, signal - mean, 0)
    variance = np.square(noise).sum(axis=0) / (n - 1)
    near = (noise[:, :, :-1] * noise[:, :, 1:]).sum() + (noise[:, :-1] * noise[:, 1:]).sum()
    means = [mean[good].mean(), variance[good].mean(), near / (n - 1) / good.sum()]
    return [*means, _clearness(signal[:, good])] if has_comb else means


def _clearness(signal: NDArray[Any]) -> float:
    """Clearness of the comb of pixels (n, P), without bias."""
    n = len(signal)
    power = np.square(np.abs(np.exp(2j * np.pi * signal).mean(axis=0)))
    return float(((n * power - 1) / (n - 1)).mean())


class Cause(NamedTuple):
    """Parameter of the device that may differ."""

    name: str
    unit: str
    expected: float
    """Value of the known device"""
    least: float = 0.0
    """Differences are relative to the expected value, or to this if larger"""
    lowest: float = -0.95
    """Smallest change that is possible"""
    step: float = 0.1
    """Change of which the closed forms of events give the slopes"""

    def value(self, size: float) -> float:
        """Return the parameter after a change, of read noise that of its square."""
        if self.name == "read noise":
            return float(np.sqrt(max(self.expected**2 + size, 0.0)))
        is_relative = self.name in ("dark counts", "efficiency")
        return self.expected * (1 + size) if is_relative else self.expected + size

    def difference(self, size: float, error: float, margin: float) -> Difference:
        """Return the difference of the parameter for a fitted change and its standard error."""
        values = [self.value(end) for end in (size, size - _95 * error, size + _95 * error)]
        scale = max(abs(self.expected), self.least, 1e-300)
        relative, low, high = ((value - self.expected) / scale for value in values)
        p = float(2 * norm.sf(abs(size) / error)) if error > 0 else 1.0
        is_equal = bool(abs(relative) + (high - low) / 2 * _90 / _95 < margin)
        size_and_range = relative, low, high, p, is_equal, scale
        return Difference(self.name, values[0], self.expected, self.unit, *size_and_range)


def _causes_of(levels: Sequence[Residual]) -> tuple[Cause, ...]:
    """Parameters that levels may show, with their values."""
    model, good = levels[0].model, next(level.good for level in levels if level.good.any())
    sensor, counter = model.sensor, model.sensor.counter
    dark_hz, mean = model.dark_hz(good), "mean of pixels"
    if many := int((~good).sum()):
        mean = f"mean of {good.sum()} pixels, without {many} that are named or saturated"
    leak_hz = max(dark_hz, 1.0)
    dead_s, carriers = sensor.dead_time.dead_time_s, sensor.afterpulsing.mean_carriers
    neighbors = sensor.crosstalk.mean_fired_neighbors
    # frames do not show the delay, which is assumed
    per_event = f"carriers per event at a delay of {1e6 * model.delay_s:.3g} µs"
    causes = [
        Cause("dark counts", f"Hz, {mean}", dark_hz),
        Cause("dead time", "s", dead_s, 1e-9, -dead_s, 0.1 * max(dead_s, 1e-7)),
        Cause("afterpulsing", per_event, carriers, 0.02, -carriers, 0.05),
        Cause("crosstalk", "neighbors per event", neighbors, 0.02, -neighbors, 0.02),
        Cause("exposure", "of the stated one", 1.0),
        Cause("light leak", "Hz", 0.0, leak_hz, 0.0, 0.1 * leak_hz),
        Cause("step", "counts per event", 1.0),
        Cause("offset", "counts", 0.0, 1.0, -20.0),
    ]
    efficiencies = [
        float(level.light_hz[level.good].mean()) / level.expected.light_hz
        for level in levels
        if level.good.any() and level.expected.light_hz
    ]
    if any(level.expected.light_hz for level in levels):
        causes.insert(1, Cause("efficiency", f"events per photon, {mean}", (*efficiencies, 0.0)[0]))
    if isinstance(counter, AnalogCounter) and levels[0].expected.codes is not None:
        # with rounding by the ADC
        noise = float(np.hypot(counter.read_noise_v, counter.lsb_v / 12**0.5) / counter.step_v)
        causes.append(Cause("read noise", "counts", noise, 0.05, -1.0))
    return tuple(causes)


class Explanation(NamedTuple):
    """A set of causes and their sizes."""

    names: tuple[str, ...]
    sizes: Floats
    errors: Floats
    chi_square: float
    p: float


@dataclass(frozen=True, eq=False)
class Causes:
    """Explanations of a difference of features."""

    p: float = 1.0
    """Chance of as large a difference between recordings of one device"""
    p_forgiven: float = 1.0
    """The same, if the model errs by what is forgiven"""
    accepted: tuple[Explanation, ...] = ()
    """Best explanation, and those nearly as good; empty if there is none or no difference"""
    alone: tuple[Difference, ...] = ()
    """Every parameter, fitted next to the accepted ones"""
    is_unexplained: bool = False
    """True if something is left that no known cause explains"""
    gain: float = 1.0
    """How much less is left of frames that were not fitted"""

    @property
    def is_different(self) -> bool:
        """True if features differ significantly, and by more than is forgiven to the model."""
        return self.p_forgiven < FALSE_ALARMS


def find_causes(
    levels: Sequence[Residual],
    *,
    margin: float,
    calibration: dict[str, float],
    is_left: bool = False,
) -> Causes:
    """Find what parameters of a device explain how captured and expected levels differ.

    Sizes are fitted to every other block of frames. Each explanation is then simulated, and is one
    only if the frames between are left with less than `_LEFT` of what differed before.
    `calibration` is the uncertainty that all levels share; `is_left` is true if something differs
    already.
    """
    if not any(level.good.sum() > 1 for level in levels):
        return Causes(is_unexplained=is_left)
    search, has_step = _Search.of(levels, calibration), levels[0].model.volts_per_count > 0
    candidates = [cause for cause in search.causes if has_step or cause.name != "step"]
    fit = search.fit([level.captured for level in levels])
    p, p_forgiven = fit.explained((), is_exact=True).p, fit.explained(()).p
    supported: list[tuple[float, float, Explanation]] = []
    before = 1.0
    if p_forgiven < FALSE_ALARMS:
        fitted, others = zip(*(_halves(level) for level in levels), strict=True)
        before = max(strength(left_of_all(others)), 1.0)
        half_fit = search.fit([half.captured for half in fitted])
        none = half_fit.explained(()).chi_square
        for many in (1, 2):
            fits = [half_fit.explained(subset) for subset in combinations(candidates, many)]
            fits = [one for one in fits if one.chi_square < 0.2 * none or one.p > REFUTED]
            # each is needed
            fits = [one for one in fits if (np.abs(one.sizes) > 4 * one.errors).all()]
            for one in sorted(fits, key=lambda one: one.chi_square)[:4]:  # these are simulated
                after = strength(left_of_all([as_explained(half, one) for half in others]))
                # one cause may leave 3 %; two explain much by chance
                if after < (0.03 if many == 1 else 1e-9) * before:
                    supported.append((after + 0.1 * one.chi_square, after, one))
            if supported:
                break
        best_score = min((score for score, *_ in supported), default=0.0)
    usual = [cause.name for cause in candidates]
    # of equals the most usual, which is the first of the list
    supported.sort(key=lambda one: (max(one[0], best_score + _EQUAL), usual.index(one[2].names[0])))
    accepted = [one for score, _, one in supported if score < 1.5 * best_score + _AS_GOOD]
    best = accepted[0].names if accepted else ()
    chosen = tuple(cause for cause in candidates if cause.name in best)
    alone = []
    for cause in candidates:
        beside = chosen if cause in chosen else (*chosen, cause)
        explanation, at = fit.explained(beside), beside.index(cause)
        size, error = float(explanation.sizes[at]), float(explanation.errors[at])
        alone.append(cause.difference(size, error, margin))
    is_unexplained = (p_forgiven < FALSE_ALARMS or is_left) and not accepted
    gain = before / max(supported[0][1], 1.0) if supported else 1.0
    return Causes(p, p_forgiven, tuple(accepted), tuple(alone), is_unexplained, gain)


def _halves(level: Residual) -> tuple[Residual, Residual]:
    """Level with every other block of its captured frames, and with those between."""
    n = len(level.captured.readings)
    is_first = np.arange(n) * 2 * BLOCKS // n % 2 == 0
    first, second = (level.captured.at(part) for part in (is_first, ~is_first))
    return replace(level, captured=first), replace(level, captured=second)


def as_explained(level: Residual, explanation: Explanation) -> Residual:
    """Return a level whose expected frames are those of a changed device."""
    moved = replace(level, uncertainty=dict(level.uncertainty), readout=list(level.readout))
    moved.quiet = {*level.quiet, "bit"}
    sizes = explanation.sizes.tolist()
    moved.redraw(7, **dict(zip(explanation.names, sizes, strict=True)))
    for name, error in zip(explanation.names, explanation.errors.tolist(), strict=True):
        moved.doubt(name, error)
    return moved


@dataclass(frozen=True, eq=False)
class _Search:
    """Expected features, their doubts, and the parameters that may change them."""

    levels: Sequence[Residual]
    causes: tuple[Cause, ...]
    good: Sequence[Mask]
    has_comb: Sequence[bool]
    known: Features
    doubted: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    """Covariance of what fluctuations and the calibration leave uncertain"""
    parabolas: dict[tuple[str, float], tuple[Floats, Floats]] = field(default_factory=dict)

    @classmethod
    def of(cls, levels: Sequence[Residual], calibration: dict[str, float]) -> "_Search":
        """Compute what is expected of the good pixels of levels."""
        good = [level.good for level in levels]
        has_comb = [
            level.expected.codes is not None
            # what was subtracted has moved the peaks
            and not level.uncertainty.keys() - {"read noise"}
            and bool(pixels.any())
            and float(level.expected.signal[:, pixels].mean()) <= 8.0
            and _clearness(level.expected.signal[:, pixels]) > 0.01
            for level, pixels in zip(levels, good, strict=True)
        ]
        known = features([level.expected for level in levels], good, has_comb)
        search = cls(levels, _causes_of(levels), good, has_comb, known)
        doubted = np.zeros_like(known.covariance)
        is_squared = (known.kind == "V") | (known.kind == "C")
        doubts = [(known.level == number, level.uncertainty) for number, level in enumerate(levels)]
        for is_of_level, uncertainty in (*doubts, (known.level >= 0, calibration)):
            doubted += np.diag((uncertainty.get("variance", 0.0) * (is_of_level & is_squared)) ** 2)
            for cause in search.causes:
                if size := uncertainty.get(cause.name, 0.0):
                    moved = np.where(is_of_level, search.change([cause], np.array([size])), 0.0)
                    doubted += np.outer(moved, moved)
        return replace(search, doubted=doubted)

    def change(self, causes: Sequence[Cause], sizes: Floats) -> Floats:
        """Return the predicted change of features."""
        known = self.known
        total, gain = np.zeros_like(known.values), 1.0
        for cause, size in zip(causes, sizes.tolist(), strict=True):
            match cause.name:
                case "step":
                    gain = 1 + size
                case "offset":
                    total = total + np.where(known.kind == "M", size, 0)
                case "read noise":
                    clearness = np.expm1(np.clip(-4 * np.pi**2 * size, -50, 1))
                    kinds = [known.kind == "V", known.kind == "K"]
                    total = total + np.select(kinds, [size, known.values * clearness])
                case _:
                    total = total + self._of_events(cause, size)
        if gain == 1:
            return total
        # means by the step, variances by its square
        power = np.select([known.kind == "M", known.kind != "K"], [1, 2])
        total = total * gain**power + known.values * (gain**power - 1)
        for at in np.flatnonzero(known.kind == "K"):  # Poisson counts, by a wrong step
            number = known.level[at]
            mean = self.levels[number].expected_mean[self.good[number]].clip(0)
            blur = np.exp(-2 * mean * (1 - np.cos(2 * np.pi * (gain - 1))))
            total[at] += known.values[at] * (float(blur.mean()) - 1)
        return total

    def slopes(self, causes: Sequence[Cause], sizes: Floats, base: Floats) -> Floats:
        """Return the derivatives (F, causes) of the predicted change, which is `base`."""
        small = np.diag([cause.step / 100 for cause in causes])
        moved = [(self.change(causes, sizes + one) - base) / one.sum() for one in small]
        return np.array(moved).T

    def _of_events(self, cause: Cause, size: float) -> Floats:
        """Change of the features by a parameter that changes the moments of events.

        A parabola through two changes of about the size, in powers of two of a step; of
        afterpulses, whose tables take seconds, a line.
        """
        is_linear, width = cause.name == "afterpulsing", cause.step
        while abs(size) > 2.5 * width and width < 8 * cause.step and not is_linear:
            width *= 2
        if (cause.name, width) not in self.parabolas:
            first = self._moved(cause.name, width)
            second = 2 * first if is_linear else self._moved(cause.name, 2 * width)
            parabola = (4 * first - second) / (2 * width), (second - 2 * first) / (2 * width**2)
            self.parabolas[cause.name, width] = parabola
        slope, bend = self.parabolas[cause.name, width]
        return slope * size + bend * size**2

    def _moved(self, parameter: str, size: float) -> Floats:
        """Change of the features by the closed forms of events."""
        moved = np.zeros_like(self.known.values)
        for number in np.unique(self.known.level):
            level, is_of_level = self.levels[number], self.known.level == number
            conditions = level.expected.exposure_s, level.light_hz
            before = level.model.moments(*conditions)
            after = level.model.moments(*conditions, parameter, size)
            for kind, unchanged, changed_ in zip("MV", before, after, strict=True):
                change = float((changed_ - unchanged)[level.good].mean())
                moved[is_of_level & (self.known.kind == kind)] = change
            if parameter == "crosstalk":
                share = float(before[1][level.good].mean()) * _coincidences(size, level)
                moved[is_of_level & (self.known.kind == "C")] = share
        return moved

    def fit(self, recordings: Sequence[Level]) -> "_Fit":
        """Return the difference of captured levels, whose errors of the model are forgiven."""
        captured, known = features(recordings, self.good, self.has_comb), self.known
        # in recordings of one device, covariances of single frames are equal
        frames = 1 / captured.frames + 1 / known.frames
        counted = (captured.covariance + known.covariance) / 2 * frames
        of_level = np.unique(known.level, return_inverse=True)[1]
        means = known.values[known.kind == "M"][of_level].clip(0)
        off = np.select([known.kind == kind for kind in _ERRORS], list(_ERRORS.values()))
        off *= np.where(known.kind == "C", means, np.abs(known.values))
        difference = captured.values - known.values
        return _Fit(difference, counted, np.diag(off**2), self)


def _coincidences(neighbors: float, level: Residual) -> float:
    """Covariance with the right and lower neighbor over the variance, by crosstalk."""
    good, parts = level.good, level.parts
    crosstalk = changed(level.model.sensor.crosstalk, mean_fired_neighbors=0.1)
    weights = neighborhoods(crosstalk).mean(axis=(0, 1))
    # each of four nearest neighbors gets a share; both directions of a pair covary
    row, column = (side // 2 for side in weights.shape)
    nearest = weights[[row - 1, row + 1, row, row], [column, column, column - 1, column + 1]].sum()
    pairs = (good[:, :-1] & good[:, 1:]).sum() + (good[:-1] & good[1:]).sum()
    # of avalanches that crosstalk adds, dead time leaves as many as of more light
    added = (parts["efficiency"] + parts["dark counts"])[good].sum()
    counted = added / max(parts["step"][good].sum(), 1e-300)
    return float(neighbors / 2 * nearest / weights.sum() * counted * pairs / good.sum())


class _Fit(NamedTuple):
    """Difference of features, and its covariances."""

    difference: Floats
    counted: Floats
    forgiven: Floats
    """Of errors of the model"""
    search: _Search

    def explained(self, causes: tuple[Cause, ...], is_exact: bool = False) -> Explanation:
        """Fit the sizes of some causes; an exact fit forgives the model nothing."""
        search, known = self.search, self.search.known
        sizes, errors = np.zeros(len(causes)), np.zeros(len(causes))
        lowest, steps = np.array([(cause.lowest, cause.step) for cause in causes]).reshape(-1, 2).T
        known_doubts = doubted = search.doubted + (0 if is_exact else self.forgiven)
        share = np.where(known.kind == "C", 3 * MODEL_ERROR, MODEL_ERROR)
        for is_last in [False] * 12 + [True] if causes else []:
            change = search.change(causes, sizes)
            if not is_last:
                doubted = known_doubts + np.diag((share * change) ** 2)
            slopes = search.slopes(causes, sizes, change) * steps
            weighted = inverses(self.counted + doubted, _SMALLEST) @ slopes
            normal = np.linalg.pinv(slopes.T @ weighted, hermitian=True)
            if is_last:
                errors = steps * np.sqrt(np.diag(normal).clip(0))
            else:
                move = steps * (normal @ (weighted.T @ (self.difference - change)))
                sizes = np.clip(sizes + np.clip(move, -1, 1), lowest, 20.0)
        left = self.difference - search.change(causes, sizes)
        # the χ² of each level has the chance of its T²
        counted, freedom, blocks = self.counted.copy(), 0, 2 * (BLOCKS - 1)
        for number in np.unique(known.level):
            block = np.ix_(known.level == number, known.level == number)
            inverse = inverses(self.counted[block], _SMALLEST)
            if size := int(np.linalg.matrix_rank(inverse)):
                of_level, rest = left[known.level == number], blocks - size + 1
                t_square = float(of_level @ inverse @ of_level)
                chance = float(f.sf(t_square * rest / (blocks * size), size, rest))
                usual = float(chi2.isf(max(chance, 1e-290), size))
                counted[block] *= t_square / usual if usual > 0 else 1.0
            freedom += size
        square = float(left @ inverses(counted + doubted, _SMALLEST) @ left)
        p = float(chi2.sf(square, max(freedom - len(causes), 1)))
        return Explanation(tuple(cause.name for cause in causes), sizes, errors, square, p)
