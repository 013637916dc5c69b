"""Global parameters that explain how two recordings differ, or none.

**Features** of every level, means over its good pixels:

    M    mean counts            V    variance of counts in time
    C    covariance of a pixel with its right and lower neighbors
    K    |mean of exp(2πi·x)|², the clearness of the comb, for codes of few counts

Each is computed in blocks of frames. Their scatter in both recordings gives the covariance of a
level's features, with so few blocks that Hotelling's T² has the distribution F, not χ²: estimated
covariances are multiplied by what gives χ² the chance of T². Calibration adds the errors of its
maps, common fluctuations add theirs.

**Causes.** Dark counts, efficiency, dead time, afterpulsing and crosstalk change the moments of
events by closed forms (`expectations`), with a parabola through two changes of about the fitted
size. A step of 1 + δ multiplies means by it and variances by its square; an offset adds to all
means; read noise of variance q adds q to all variances and multiplies K by exp(−4π²·q).

**Choice.** `p` is the chance of the difference between recordings of one device. A difference is
stated where that is below `FALSE_ALARMS` even if the model errs by `_ERRORS`. The fewest causes, at
most two, whose χ² has a chance above `REFUTED` explain it. If other sets of as many do so nearly as
well, the cause is ambiguous. If no set does, none of the known causes explains it. Predicted
changes are allowed an error of `MODEL_ERROR`, those of covariances, which are first-order, of three
times as much.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag
from scipy.ndimage import convolve
from scipy.stats import chi2, f, norm

from megalopta.core.arrays import Floats, Ints, Mask
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.change import changed
from megalopta.sensor.compare.model import Change, Model, Parts, Unsure
from megalopta.sensor.compare.two_sample import BLOCKS, Difference
from megalopta.sensor.effects.crosstalk import neighborhoods
from megalopta.sensor.spad.counters import AnalogCounter

REFUTED = 1e-3
"""Chance of its χ² below which an explanation is refuted."""
FALSE_ALARMS = 2e-3
"""Chance of a χ² above which no difference is seen."""
MODEL_ERROR = 0.04
"""Relative error of a predicted change."""
_AS_GOOD = 9.0
"""Difference of χ² up to which two explanations are equally good."""
_MOST = 2
_FEW_COUNTS = 8.0
_FAINT = 0.01
"""Clearness of the comb below which it is not used."""
_ERRORS = {"M": 2e-3, "V": 5e-3, "K": 1e-2}
"""Relative errors of expected features that are forgiven to the model."""
_COMMON_ERROR = 1e-3
"""Error of expected covariances over the mean that is forgiven"""
_ROUNDS = 12
_95, _90 = 1.959964, 1.644854
_CROSS = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]])
_LARGEST_STEP = 8


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
    kind: tuple[str, ...]
    """(F,) one of M, V, C, K"""

    def of(self, kind: str) -> Mask:
        """Return True for one kind of features, (F,)."""
        return np.array([each == kind for each in self.kind])


def features(levels: Sequence[Level], good: Sequence[Mask], has_comb: Sequence[bool]) -> Features:
    """Return the features of the good pixels of all levels."""
    values, covariances, places, frames = [], [], [], []
    kinds: list[str] = []
    for at, (level, pixels, comb) in enumerate(zip(levels, good, has_comb, strict=True)):
        if pixels.sum() < 2:
            continue
        names = ("M", "V", "C", "K") if comb else ("M", "V", "C")
        edges = np.linspace(0, len(level.readings), BLOCKS + 1).astype(int)
        blocks = np.array(
            [
                _of_frames(np.asarray(level.signal[first:end], np.float32), pixels, comb)
                for first, end in pairwise(edges)
            ]
        )
        values.append(blocks.mean(axis=0))
        covariances.append(np.cov(blocks.T) * len(level.readings) / BLOCKS)
        places += [at] * len(names)
        frames += [len(level.readings)] * len(names)
        kinds += names
    if not values:
        return Features(np.zeros(0), np.zeros((0, 0)), np.zeros(0, int), np.zeros(0, int), ())
    total = block_diag(*covariances)
    return Features(np.concatenate(values), total, np.array(frames), np.array(places), tuple(kinds))


def _of_frames(signal: Floats, good: Mask, comb: bool) -> Floats:
    n = len(signal)
    mean = signal.mean(axis=0, dtype=np.float64)
    apart = np.where(good, signal - mean, 0)
    variance = np.square(apart).sum(axis=0) / (n - 1)
    near = (apart[:, :, :-1] * apart[:, :, 1:]).sum() + (apart[:, :-1] * apart[:, 1:]).sum()
    found = [mean[good].mean(), variance[good].mean(), near / (n - 1) / good.sum()]
    if comb:
        wave = np.exp(2j * np.pi * signal[:, good]).mean(axis=0)
        found.append(((n * np.square(np.abs(wave)) - 1) / (n - 1)).mean())
    return np.array(found, np.float64)


@dataclass(frozen=True, eq=False)
class _Expected:
    """Recordings that the known device makes, and their features."""

    features: Features
    levels: Sequence[Level]
    good: Sequence[Mask]
    model: Model
    parts: Sequence[Parts]
    means: Sequence[Floats]
    """Mean counts of the good pixels of each level"""


@dataclass(frozen=True, eq=False, kw_only=True)
class Cause:
    """A parameter of the device that may differ: its change of features, and how it is told."""

    name: str
    field: str
    """Field of `Unsure`"""
    unit: str
    expected: float
    """Value of the known device"""
    least: float = 0.0
    """Differences are relative to the expected value, or to this if larger"""
    lowest: float = -0.95
    """Smallest change that is possible"""
    is_relative: bool = False
    """True if changes are relative to the expected value"""
    small: float = 1e-3
    """Change over which slopes are taken"""

    def change(self, size: float) -> Floats | float:
        """Return the change of all features by a change of the parameter."""
        return 0.0

    def gain(self, size: float) -> float:
        """Return the factor on all counts."""
        return 1.0

    def value(self, size: float) -> float:
        """Return the parameter after a change."""
        return self.expected * (1 + size) if self.is_relative else self.expected + size

    def difference(self, size: float, error: float, margin: float) -> Difference:
        """Return the difference of the parameter for a fitted change and its standard error."""
        values = [self.value(end) for end in (size, size - _95 * error, size + _95 * error)]
        scale = max(abs(self.expected), self.least, 1e-300)
        relative, low, high = ((value - self.expected) / scale for value in values)
        p = float(2 * norm.sf(abs(size) / error)) if error > 0 else 1.0
        half = (high - low) / 2 * _90 / _95
        is_equivalent = bool(abs(relative) + half < margin)
        return Difference(
            self.name, values[0], self.expected, self.unit, relative, low, high, p, is_equivalent,
            scale,
        )  # fmt: skip


@dataclass(frozen=True, eq=False, kw_only=True)
class _OfEvents(Cause):
    """A parameter that changes the moments of events, by their closed forms."""

    seen: _Expected
    parameter: str
    """Field of `Change`"""
    step: float
    """Change through which, and twice which, a parabola is laid"""
    is_linear: bool = False
    """True if one change has to do: tables of afterpulses take seconds"""
    bends: dict[float, tuple[Floats, Floats]] = field(default_factory=dict)
    """Slope and curvature of the features, by the step"""

    def change(self, size: float) -> Floats:
        """Return the change by a parabola through two changes of about this size."""
        step = self.step
        largest = 0.0 if self.is_linear else _LARGEST_STEP * self.step
        while abs(size) > 2.5 * step and step < largest:
            step *= 2
        if step not in self.bends:
            one = self._moved(step)
            two = 2 * one if self.is_linear else self._moved(2 * step)
            self.bends[step] = (4 * one - two) / (2 * step), (two - 2 * one) / (2 * step**2)
        slope, bend = self.bends[step]
        return slope * size + bend * size**2

    def _moved(self, size: float) -> Floats:
        expected, model = self.seen.features, self.seen.model
        moved = np.zeros_like(expected.values)
        for at, (level, good) in enumerate(zip(self.seen.levels, self.seen.good, strict=True)):
            here = expected.level == at
            if not here.any():
                continue
            light = np.asarray(model.rates_hz[at], np.float64).mean(axis=0)
            before = model.moments(level, light, Change())
            after = model.moments(level, light, Change(**{self.parameter: size}))
            for kind, one, other in zip("MV", before, after, strict=True):
                moved[here & expected.of(kind)] = float((other - one)[good].mean())
            if self.parameter == "neighbors":
                variance = float(before[1][good].mean())
                moved[here & expected.of("C")] = variance * self._coincidences(size, at)
        return moved

    def _coincidences(self, neighbors: float, at: int) -> float:
        """Covariance with the right and lower neighbor over the variance, by crosstalk."""
        good, part = self.seen.good[at], self.seen.parts[at]
        crosstalk = changed(self.seen.model.sensor.crosstalk, mean_fired_neighbors=0.1)
        weights = neighborhoods(crosstalk).mean(axis=(0, 1))
        # each of four nearest neighbors gets a share; both directions of a pair covary
        nearest = convolve(weights, _CROSS, mode="constant")[tuple(np.array(weights.shape) // 2)]
        share = neighbors * nearest / 4 / weights.sum()
        pairs = (good[:, :-1] & good[:, 1:]).sum() + (good[:-1] & good[1:]).sum()
        # of avalanches that crosstalk adds, dead time leaves as many as of more light
        counted = float((part.light + part.dark)[good].sum() / max(part.mean[good].sum(), 1e-300))
        return float(2 * share * counted * pairs / good.sum())


class _Step(Cause):
    """The step of the counters, which multiplies all counts."""

    def gain(self, size: float) -> float:
        """Return the factor on all counts."""
        return 1 + size


@dataclass(frozen=True, eq=False, kw_only=True)
class _Offset(Cause):
    seen: Features

    def change(self, size: float) -> Floats:
        """Return the same change of all means."""
        return np.where(self.seen.of("M"), size, 0)


@dataclass(frozen=True, eq=False, kw_only=True)
class _ReadNoise(Cause):
    seen: Features

    def change(self, size: float) -> Floats:
        """Return the change of all variances, and of the clearness of the comb."""
        clear = self.seen.values * np.expm1(np.clip(-4 * np.pi**2 * size, -50, 1))
        noise = np.where(self.seen.of("V"), size, 0)
        return np.asarray(noise + np.where(self.seen.of("K"), clear, 0))

    def value(self, size: float) -> float:
        """Return the noise, whose square changes."""
        return float(np.sqrt(max(self.expected**2 + size, 0.0)))


def _causes_of(seen: _Expected) -> tuple[Cause, ...]:
    """All causes that recordings can tell."""
    model, sensor = seen.model, seen.model.sensor
    good = next((pixels for pixels in seen.good if pixels.any()), None)
    lit = [
        float(np.asarray(rate).mean(axis=0)[pixels].mean()) / level.light_hz
        for level, pixels, rate in zip(seen.levels, seen.good, model.rates_hz, strict=True)
        if pixels.any() and level.light_hz
    ]
    dead_s, carriers = sensor.dead_time.dead_time_s, sensor.afterpulsing.mean_carriers
    neighbors = sensor.crosstalk.mean_fired_neighbors
    # frames do not show the delay, which is assumed
    of_carriers = f"carriers per event at a delay of {1e6 * model.delay_s:.3g} µs"
    causes: list[Cause] = [
        _OfEvents(
            name="dark counts", field="dark_counts", unit="Hz", is_relative=True, seen=seen,
            expected=model.dark_hz(good) if good is not None else 0.0,
            parameter="dark_counts", step=0.1,
        ),
        _OfEvents(
            name="efficiency", field="efficiency", unit="events per photon", is_relative=True,
            expected=lit[0] if lit else 0.0, seen=seen, parameter="efficiency", step=0.1,
        ),
        _OfEvents(
            name="dead time", field="", unit="s", expected=dead_s, least=1e-9, lowest=-dead_s,
            small=1e-3 * (dead_s or 1e-7), seen=seen, parameter="dead_time_s",
            step=0.1 * max(dead_s, 1e-7),
        ),
        _OfEvents(
            name="afterpulsing", field="", unit=of_carriers, expected=carriers, least=0.02,
            lowest=-carriers, seen=seen, parameter="carriers", step=0.05, is_linear=True,
        ),
        _OfEvents(
            name="crosstalk", field="", unit="neighbors per event", expected=neighbors, least=0.02,
            lowest=-neighbors, seen=seen, parameter="neighbors", step=0.02,
        ),
        _Step(name="step", field="step", unit="counts per event", expected=1.0),
    ]  # fmt: skip
    if not any(level.light_hz for level in seen.levels):
        del causes[1]
    if seen.levels[0].codes is not None:
        counter, noise = sensor.counter, 0.0
        if isinstance(counter, AnalogCounter):  # with rounding by the ADC
            noise = np.hypot(counter.read_noise_v, counter.lsb_v / 12**0.5) / counter.step_v
        causes += [
            _Offset(
                name="offset", field="offset", unit="counts", expected=0.0, least=1.0,
                lowest=-20.0, seen=seen.features,
            ),
            _ReadNoise(
                name="read noise", field="read_noise", unit="counts", expected=float(noise),
                least=0.05, lowest=-1.0, seen=seen.features,
            ),
        ]  # fmt: skip
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

    @property
    def is_different(self) -> bool:
        """True if features differ significantly, and by more than is forgiven to the model."""
        return self.p_forgiven < FALSE_ALARMS

    @property
    def is_unexplained(self) -> bool:
        """True if they differ and no known cause explains it."""
        return self.is_different and not self.accepted


def find_causes(
    captured: Sequence[Level], expected: Sequence[Level], good: Sequence[Mask], model: Model,
    *, margin: float, unsure: Sequence[Unsure], maps: Unsure,
) -> Causes:  # fmt: skip
    """Fit the parameters of a device to captured and expected levels and their good pixels.

    `unsure` are the uncertainties of each level; `maps` those of the calibration, which all share.
    """
    comb = [  # what was subtracted has moved the peaks
        _has_comb(level, pixels) and not of_level._replace(read_noise=0.0).is_any
        for level, pixels, of_level in zip(expected, good, unsure, strict=True)
    ]
    one, other = features(captured, good, comb), features(expected, good, comb)
    if not one.values.size:
        return Causes()
    means = [
        np.asarray(level.signal.mean(axis=0))[pixels].clip(0)
        for level, pixels in zip(expected, good, strict=True)
    ]
    seen = _Expected(other, expected, good, model, model.parts(expected), means)
    causes = _causes_of(seen)
    # in recordings of one device, those of single frames are equal
    counted = (one.covariance + other.covariance) / 2 * (1 / one.frames + 1 / other.frames)
    doubted = _doubted(seen, causes, unsure, maps)
    fit = _Fit(one.values - other.values, counted, doubted, seen)
    p = fit.explained(()).p
    # errors of the model are forgiven
    off = np.select([other.of(kind) for kind in _ERRORS], list(_ERRORS.values()))
    common = np.array([seen.means[level].mean() for level in other.level])
    off = np.where(other.of("C"), _COMMON_ERROR * common, off * np.abs(other.values))
    fit = fit._replace(doubted=doubted + np.diag(off**2))
    p_forgiven = fit.explained(()).p
    accepted = _accepted(fit, causes) if p_forgiven < FALSE_ALARMS else ()
    names = accepted[0].names if accepted else ()
    chosen = tuple(cause for name in names for cause in causes if cause.name == name)
    alone = []
    for cause in causes:
        both = chosen if cause in chosen else (*chosen, cause)
        explanation, at = fit.explained(both), both.index(cause)
        size, error = float(explanation.sizes[at]), float(explanation.errors[at])
        alone.append(cause.difference(size, error, margin))
    return Causes(p, p_forgiven, accepted, tuple(alone))


def _has_comb(level: Level, good: Mask) -> bool:
    if level.codes is None or not good.any():
        return False
    signal = np.asarray(level.signal, np.float32)[:, good]
    if float(signal.mean()) > _FEW_COUNTS:
        return False
    n = len(signal)
    power = np.square(np.abs(np.exp(2j * np.pi * signal).mean(axis=0)))
    return float(((n * power - 1) / (n - 1)).mean()) > _FAINT


def _doubted(
    seen: _Expected, causes: Sequence[Cause], unsure: Sequence[Unsure], maps: Unsure
) -> Floats:
    """Covariance of the features due to fluctuations and calibration."""
    expected, total = seen.features, np.zeros_like(seen.features.covariance)
    for level, of_level in enumerate([*unsure, maps]):
        here = expected.level == level if level < len(unsure) else np.full(total.shape[0], True)
        slope = np.where(here & (expected.of("V") | expected.of("C")), 1.0, 0.0)
        total += np.diag((of_level.variance * slope) ** 2)
        for cause in causes:
            size = getattr(of_level, cause.field) if cause.field else 0.0
            if size:
                moved = np.where(here, _change(seen, [cause], np.array([size])), 0.0)
                total += np.outer(moved, moved)
    return total


def _change(seen: _Expected, causes: Sequence[Cause], sizes: Floats) -> Floats:
    """Predicted change of features."""
    expected = seen.features
    total, gain = np.zeros_like(expected.values), 1.0
    for cause, size in zip(causes, sizes, strict=True):
        total = total + cause.change(float(size))
        gain *= cause.gain(float(size))
    if gain == 1:
        return total
    power = np.select([expected.of("M"), expected.of("V") | expected.of("C")], [1, 2])
    total = total * gain**power + expected.values * (gain**power - 1)
    for at in np.flatnonzero(expected.of("K")):  # the comb of Poisson counts, by a wrong step
        mean = seen.means[expected.level[at]]
        blur = np.exp(-2 * mean * (1 - np.cos(2 * np.pi * (gain - 1))))
        total[at] += expected.values[at] * (float(blur.mean()) - 1)
    return total


def _accepted(fit: "_Fit", causes: Sequence[Cause]) -> tuple[Explanation, ...]:
    """Smallest sets of causes that are not refuted, the best first."""
    for many in range(1, _MOST + 1):
        tried = [fit.explained(some) for some in combinations(causes, many)]
        held = sorted((each for each in tried if each.p > REFUTED), key=lambda e: e.chi_square)
        if held:
            return tuple(e for e in held if e.chi_square - held[0].chi_square < _AS_GOOD)
    return ()


def _inverse(covariance: Floats) -> Floats:
    """Inverse of a covariance matrix, for entries of any unit; 0 where nothing varies."""
    size = np.sqrt(np.diagonal(covariance))
    scale = np.divide(1, size, out=np.zeros_like(size), where=size > 0)
    inverse = np.linalg.pinv(scale[:, None] * covariance * scale, rcond=1e-10, hermitian=True)
    return np.asarray(scale[:, None] * inverse * scale)


class _Fit(NamedTuple):
    """Difference of features, and its covariance by counting and by doubts."""

    difference: Floats
    counted: Floats
    doubted: Floats
    seen: _Expected

    def explained(self, causes: tuple[Cause, ...]) -> Explanation:
        """Fit the sizes of some causes."""
        sizes, errors = np.zeros(len(causes)), np.zeros(len(causes))
        lowest = np.array([cause.lowest for cause in causes])
        doubted, covariance = self.doubted, self.counted + self.doubted
        for _ in range(_ROUNDS if causes else 0):
            base = _change(self.seen, causes, sizes)
            is_common = self.seen.features.of("C")
            error = np.where(is_common, 3 * MODEL_ERROR, MODEL_ERROR) * np.abs(base)
            doubted = self.doubted + np.diag(error**2)
            covariance = self.counted + doubted
            slopes = self._slopes(causes, sizes, base)
            weighted = _inverse(covariance) @ slopes
            normal = np.linalg.pinv(slopes.T @ weighted, hermitian=True)
            step = normal @ (weighted.T @ (self.difference - base))
            sizes = np.clip(sizes + np.clip(step, -1, 1), lowest, 20.0)
        change = _change(self.seen, causes, sizes)
        left = self.difference - change
        if causes:
            slopes = self._slopes(causes, sizes, change)
            information = slopes.T @ _inverse(covariance) @ slopes
            errors = np.sqrt(np.diag(np.linalg.pinv(information, hermitian=True)).clip(0))
        # the χ² of each level has the chance of its T²
        known, freedom, blocks = np.zeros_like(self.counted), 0, 2 * (BLOCKS - 1)
        for number in np.unique(self.seen.features.level):
            here = self.seen.features.level == number
            block = np.ix_(here, here)
            inverse = _inverse(self.counted[block])
            size = int(np.linalg.matrix_rank(inverse))
            t_square = float(left[here] @ inverse @ left[here])
            rest = blocks - size + 1
            chance = f.sf(t_square * rest / (blocks * size), size, rest) if size else 1.0
            wanted = chi2.isf(max(chance, 1e-290), size) if size else 0.0
            known[block] = self.counted[block] * (t_square / wanted if wanted > 0 else 1.0)
            freedom += size
        square = float(left @ _inverse(known + doubted) @ left)
        freedom = max(freedom - len(causes), 1)
        names = tuple(cause.name for cause in causes)
        return Explanation(names, sizes, errors, square, float(chi2.sf(square, freedom)))

    def _slopes(self, causes: Sequence[Cause], sizes: Floats, base: Floats) -> Floats:
        slopes = []
        for at, cause in enumerate(causes):
            moved = sizes.copy()
            moved[at] += cause.small
            slopes.append((_change(self.seen, causes, moved) - base) / cause.small)
        return np.array(slopes).T
