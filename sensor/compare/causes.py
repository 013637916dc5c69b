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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag
from scipy.ndimage import convolve
from scipy.stats import chi2, f, norm

from megalopta.core.arrays import Floats, Ints, Mask
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.change import changed
from megalopta.sensor.compare.model import Change, Model
from megalopta.sensor.compare.quantities import BLOCKS
from megalopta.sensor.compare.two_sample import Difference, Quantity
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
_ROUNDS = 12
_95, _90 = 1.959964, 1.644854
_FIELDS = {
    "dark counts": "dark_counts",
    "efficiency": "efficiency",
    "dead time": "dead_time_s",
    "afterpulsing": "carriers",
    "crosstalk": "neighbors",
}
"""Fields of `Change`"""
_UNITS: Mapping[str, tuple[str, float]] = {
    "dark counts": ("Hz", 0.0),
    "efficiency": ("events per photon", 0.0),
    "dead time": ("s", 1e-9),
    "afterpulsing": ("carriers per event", 0.02),
    "crosstalk": ("neighbors per event", 0.02),
    "step": ("counts per event", 0.0),
    "offset": ("counts", 1.0),
    "read noise": ("counts", 0.05),
}
"""Units of parameters, and the values to which changes of smaller ones are relative"""
_CROSS = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]])
_LARGEST_STEP = 8
_STEPS = {"dark counts": 0.1, "efficiency": 0.1, "afterpulsing": 0.05, "crosstalk": 0.02}


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
    for at, (level, own, comb) in enumerate(zip(levels, good, has_comb, strict=True)):
        if own.sum() < 2:
            continue
        names = ("M", "V", "C", "K") if comb else ("M", "V", "C")
        edges = np.linspace(0, len(level.readings), BLOCKS + 1).astype(int)
        blocks = np.array(
            [
                _of_frames(np.asarray(level.signal[first:end], np.float32), own, comb)
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

    p: float
    """Chance of as large a difference between recordings of one device"""
    p_forgiven: float
    """The same, if the model errs by what is forgiven"""
    accepted: tuple[Explanation, ...]
    """Best explanation, and those nearly as good; empty if there is none or no difference"""
    alone: tuple[Difference, ...]
    """Every parameter, fitted next to the accepted ones"""

    @property
    def is_different(self) -> bool:
        """True if features differ significantly, and by more than is forgiven to the model."""
        return self.p_forgiven < FALSE_ALARMS

    @property
    def is_unexplained(self) -> bool:
        """True if they differ and no known cause explains it."""
        return self.is_different and not self.accepted


class Doubts(NamedTuple):
    """Uncertainties besides that of counting."""

    fluctuations: Sequence[Mapping[str, float]]
    """Uncertainties of each level's parameters, by name, and of "variance" (counts²)"""
    maps: Mapping[str, float]
    """Errors of the calibration: relative ones of dark counts and of efficiency of the array"""


def find_causes(
    captured: Sequence[Level], expected: Sequence[Level], good: Sequence[Mask], model: Model,
    *, margin: float, doubts: Doubts,
) -> Causes:  # fmt: skip
    """Fit the parameters of a device to captured and expected levels and their good pixels."""
    comb = [  # what was subtracted has moved the peaks
        _has_comb(level, own) and not set(unsure) - {"read noise"}
        for level, own, unsure in zip(expected, good, doubts.fluctuations, strict=True)
    ]
    one, other = features(captured, good, comb), features(expected, good, comb)
    if not one.values.size:
        return Causes(1.0, 1.0, (), ())
    # in recordings of one device, those of single frames are equal
    counted = (one.covariance + other.covariance) / 2 * (1 / one.frames + 1 / other.frames)
    fit = _Fit(one.values - other.values, counted, other, model, expected, good)
    fit.doubted = fit.doubt(doubts)
    p = fit.explained(()).p
    fit.doubted = fit.doubted + fit.forgiven()
    p_forgiven = fit.explained(()).p
    accepted = _accepted(fit) if p_forgiven < FALSE_ALARMS else ()
    names = accepted[0].names if accepted else ()
    alone = tuple(fit.next_to(names, name, margin) for name in fit.names)
    return Causes(p, p_forgiven, accepted, alone)


def _accepted(fit: "_Fit") -> tuple[Explanation, ...]:
    """Smallest sets of causes that are not refuted, the best first."""
    for many in range(1, _MOST + 1):
        tried = [fit.explained(names) for names in combinations(fit.names, many)]
        held = sorted((each for each in tried if each.p > REFUTED), key=lambda e: e.chi_square)
        if held:
            return tuple(e for e in held if e.chi_square - held[0].chi_square < _AS_GOOD)
    return ()


def _has_comb(level: Level, good: Mask) -> bool:
    if level.codes is None or not good.any():
        return False
    signal = np.asarray(level.signal, np.float32)[:, good]
    if float(signal.mean()) > _FEW_COUNTS:
        return False
    n = len(signal)
    power = np.square(np.abs(np.exp(2j * np.pi * signal).mean(axis=0)))
    return float(((n * power - 1) / (n - 1)).mean()) > _FAINT


def _as_if_known(left: Floats, counted: Floats, level: Ints) -> tuple[Floats, int]:
    """Covariance in which the χ² of each level has the chance of its T²; degrees of freedom."""
    known, freedom, blocks = np.zeros_like(counted), 0, 2 * (BLOCKS - 1)
    for number in np.unique(level):
        here = level == number
        block = np.ix_(here, here)
        inverse = _inverse(counted[block])
        size = int(np.linalg.matrix_rank(inverse))
        square = float(left[here] @ inverse @ left[here])
        rest = blocks - size + 1
        chance = f.sf(square * rest / (blocks * size), size, rest) if size else 1.0
        wanted = chi2.isf(max(chance, 1e-290), size) if size else 0.0
        known[block] = counted[block] * (square / wanted if wanted > 0 else 1.0)
        freedom += size
    return known, freedom


def _inverse(covariance: Floats) -> Floats:
    """Inverse of a covariance matrix, for entries of any unit; 0 where nothing varies."""
    size = np.sqrt(np.diagonal(covariance))
    scale = np.divide(1, size, out=np.zeros_like(size), where=size > 0)
    inverse = np.linalg.pinv(scale[:, None] * covariance * scale, rcond=1e-10, hermitian=True)
    return np.asarray(scale[:, None] * inverse * scale)


class _Fit:
    """Fit of causes to a difference of features."""

    def __init__(
        self, difference: Floats, counted: Floats, expected: Features, model: Model,
        levels: Sequence[Level], good: Sequence[Mask],
    ) -> None:  # fmt: skip
        self.difference, self.counted, self.expected = difference, counted, expected
        self.doubted = np.zeros_like(counted)
        self.model, self.levels, self.good = model, levels, good
        self._bends: dict[tuple[str, float], tuple[Floats, Floats]] = {}
        self._means = [
            np.asarray(level.signal.mean(axis=0))[own].clip(0)
            for level, own in zip(levels, good, strict=True)
        ]
        self._parts = model.parts(levels)
        lit = any(level.light_hz for level in levels)
        names = ["dark counts", *(["efficiency"] if lit else []), "dead time", "afterpulsing"]
        names += ["crosstalk", "step"]
        if levels[0].codes is not None:
            names += ["offset", "read noise"]
        self.names = tuple(names)

    def doubt(self, doubts: Doubts) -> Floats:
        """Covariance of the features due to fluctuations and calibration."""
        expected, total = self.expected, np.zeros_like(self.counted)
        for level, unsure in enumerate(doubts.fluctuations):
            here = expected.level == level
            for name, size in unsure.items():
                if name == "variance":
                    slope = np.where(here & (expected.of("V") | expected.of("C")), 1.0, 0.0)
                    total += np.diag((size * slope) ** 2)
                elif name in self.names:
                    moved = np.where(here, self.change([name], np.array([size])), 0.0)
                    total += np.outer(moved, moved)
        for name, error in doubts.maps.items():
            if error and name in self.names:
                moved = self.change([name], np.array([error]))
                total += np.outer(moved, moved)
        return total

    def forgiven(self) -> Floats:
        """Covariance of the features due to errors of the model."""
        kinds, shares = [self.expected.of(kind) for kind in _ERRORS], list(_ERRORS.values())
        common = np.array([self._means[int(level)].mean() for level in self.expected.level])
        off = np.select(kinds, shares) * np.abs(self.expected.values)
        return np.diag(np.where(self.expected.of("C"), 1e-3 * common, off) ** 2)

    def change(self, names: Sequence[str], sizes: Floats) -> Floats:
        """Predicted change of features."""
        total = np.zeros_like(self.difference)
        gain, expected = 1.0, self.expected
        for name, size in zip(names, sizes, strict=True):
            if name == "step":
                gain = 1 + size
            elif name == "offset":
                total += np.where(expected.of("M"), size, 0)
            elif name == "read noise":
                noise = np.where(expected.of("V"), size, 0)
                clear = expected.values * np.expm1(np.clip(-4 * np.pi**2 * size, -50, 1))
                total += noise + np.where(expected.of("K"), clear, 0)
            else:
                slope, bend = self._bend(name, float(size))
                total += slope * size + bend * size**2
        if gain != 1:
            power = np.array([{"M": 1, "V": 2, "C": 2}.get(each, 0) for each in expected.kind])
            total = total * gain**power + expected.values * (gain**power - 1)
            total += np.where(expected.of("K"), self._blurred(gain - 1), 0)
        return total

    def _blurred(self, step: float) -> Floats:
        """Change of the comb's clearness by a wrong step, for Poisson counts."""
        change = np.zeros_like(self.difference)
        for at in np.flatnonzero(self.expected.of("K")):
            level = int(self.expected.level[at])
            mean = self._means[level]
            blur = np.exp(-2 * mean * (1 - np.cos(2 * np.pi * step)))
            change[at] = self.expected.values[at] * (float(blur.mean()) - 1)
        return change

    def _bend(self, name: str, size: float) -> tuple[Floats, Floats]:
        """Slope and curvature of the features over the size of a cause, at sizes like this one."""
        step = _STEPS.get(name) or 0.1 * max(self.model.sensor.dead_time.dead_time_s, 1e-7)
        is_linear = name == "afterpulsing"  # tables take seconds
        largest = 0.0 if is_linear else _LARGEST_STEP * _STEPS.get(name, step)
        while abs(size) > 2.5 * step and step < largest:
            step *= 2
        if (name, step) not in self._bends:
            one = self._moved(name, step)
            two = 2 * one if is_linear else self._moved(name, 2 * step)
            self._bends[name, step] = (4 * one - two) / (2 * step), (two - 2 * one) / (2 * step**2)
        return self._bends[name, step]

    def _moved(self, name: str, size: float) -> Floats:
        """Change of the features' closed forms."""
        change = Change(**{_FIELDS[name]: size})
        found = np.zeros_like(self.difference)
        for at, (level, own) in enumerate(zip(self.levels, self.good, strict=True)):
            here = self.expected.level == at
            if not here.any():
                continue
            light = np.asarray(self.model.rates_hz[at], np.float64).mean(axis=0)
            moments = [self.model.moments(level, light, each) for each in (Change(), change)]
            mean, variance = (
                float((after - before)[own].mean()) for before, after in zip(*moments, strict=True)
            )
            found[here & self.expected.of("M")] = mean
            found[here & self.expected.of("V")] = variance
            if name == "crosstalk":
                base = float(moments[0][1][own].mean())
                found[here & self.expected.of("C")] = base * self._coincidences(size, at)
        return found

    def _coincidences(self, neighbors: float, at: int) -> float:
        """Covariance with the right and lower neighbor over the variance, by crosstalk."""
        own, part = self.good[at], self._parts[at]
        crosstalk = changed(self.model.sensor.crosstalk, mean_fired_neighbors=0.1)
        weights = neighborhoods(crosstalk).mean(axis=(0, 1))
        # each of four nearest neighbors gets a share; both directions of a pair covary
        nearest = convolve(weights, _CROSS, mode="constant")[tuple(np.array(weights.shape) // 2)]
        share = neighbors * nearest / 4 / weights.sum()
        pairs = (own[:, :-1] & own[:, 1:]).sum() + (own[:-1] & own[1:]).sum()
        # of avalanches that crosstalk adds, dead time leaves as many as of more light
        counted = float((part.light + part.dark)[own].sum() / max(part.mean[own].sum(), 1e-300))
        return float(2 * share * counted * pairs / own.sum())

    def explained(self, names: tuple[str, ...]) -> Explanation:
        """Fit the sizes of some causes."""
        sizes = np.zeros(len(names))
        doubted, covariance = self.doubted, self.counted + self.doubted
        for _ in range(_ROUNDS if names else 0):
            base = self.change(names, sizes)
            error = np.where(self.expected.of("C"), 3 * MODEL_ERROR, MODEL_ERROR) * np.abs(base)
            doubted = self.doubted + np.diag(error**2)
            covariance = self.counted + doubted
            slopes = self._slopes(names, sizes, base)
            weighted = _inverse(covariance) @ slopes
            normal = np.linalg.pinv(slopes.T @ weighted, hermitian=True)
            step = normal @ (weighted.T @ (self.difference - base))
            sizes = np.clip(sizes + np.clip(step, -1, 1), self._least(names), 20.0)
        left = self.difference - self.change(names, sizes)
        errors = np.zeros(len(names))
        if names:
            slopes = self._slopes(names, sizes, self.change(names, sizes))
            information = slopes.T @ _inverse(covariance) @ slopes
            errors = np.sqrt(np.diag(np.linalg.pinv(information, hermitian=True)).clip(0))
        known, freedom = _as_if_known(left, self.counted, self.expected.level)
        square = float(left @ _inverse(known + doubted) @ left)
        freedom = max(freedom - len(names), 1)
        return Explanation(names, sizes, errors, square, float(chi2.sf(square, freedom)))

    def next_to(self, names: tuple[str, ...], name: str, margin: float) -> Difference:
        """Difference of one parameter, fitted with the accepted causes."""
        both = names if name in names else (*names, name)
        found = self.explained(both)
        at = both.index(name)
        size, error = float(found.sizes[at]), float(found.errors[at])
        quantity, base = self._quantity(name)
        ends = [size, size - _95 * error, size + _95 * error]
        values = [self._value(name, base, each) for each in ends]
        scale = max(abs(base), quantity.least, 1e-300)
        relative, low, high = ((each - base) / scale for each in values)
        p = float(2 * norm.sf(abs(size) / error)) if error > 0 else 1.0
        half = (high - low) / 2 * _90 / _95
        is_equivalent = bool(abs(relative) + half < margin)
        return Difference(
            name, values[0], base, quantity.unit, relative, low, high, p, is_equivalent, scale
        )

    def _quantity(self, name: str) -> tuple[Quantity, float]:
        """Unit of a parameter, and its expected value."""
        sensor = self.model.sensor
        expected = {
            "dark counts": self._rate(is_dark=True),
            "efficiency": self._rate(is_dark=False),
            "dead time": sensor.dead_time.dead_time_s,
            "afterpulsing": sensor.afterpulsing.mean_carriers,
            "crosstalk": sensor.crosstalk.mean_fired_neighbors,
            "step": 1.0,
            "offset": 0.0,
            "read noise": self._read_noise(),
        }
        unit, least = _UNITS[name]
        if name == "afterpulsing":  # frames do not show the delay, which is assumed
            unit += f" at a delay of {1e9 * self.model.delay_s:.3g} ns"
        return Quantity(name, unit, least), expected[name]

    def _rate(self, *, is_dark: bool) -> float:
        """Mean dark counts, Hz, or events per unit of light."""
        for level, own, rate in zip(self.levels, self.good, self.model.rates_hz, strict=True):
            if own.any() and is_dark:
                return self.model.dark_hz(own)
            if own.any() and level.light_hz:
                return float(np.asarray(rate).mean(axis=0)[own].mean()) / level.light_hz
        return 0.0

    def _read_noise(self) -> float:
        """Read noise of the device in counts, rounding by the ADC included."""
        counter = self.model.sensor.counter
        if not isinstance(counter, AnalogCounter):
            return 0.0
        return float(np.hypot(counter.read_noise_v, counter.lsb_v / 12**0.5) / counter.step_v)

    def _value(self, name: str, base: float, size: float) -> float:
        """Value of a parameter after a change of this size."""
        if name == "read noise":
            return float(np.sqrt(max(base**2 + size, 0.0)))
        if name in ("dark counts", "efficiency"):
            return base * (1 + size)
        return base + size

    def _least(self, names: Sequence[str]) -> Floats:
        dead = self.model.sensor.dead_time.dead_time_s
        least = {"dark counts": -0.95, "efficiency": -0.95, "step": -0.95, "dead time": -dead,
                 "afterpulsing": -self.model.sensor.afterpulsing.mean_carriers,
                 "crosstalk": -self.model.sensor.crosstalk.mean_fired_neighbors,
                 "offset": -20.0, "read noise": -1.0}  # fmt: skip
        return np.array([least[name] for name in names])

    def _slopes(self, names: Sequence[str], sizes: Floats, base: Floats | float) -> Floats:
        found = []
        for at, name in enumerate(names):
            moved = sizes.copy()
            step = 1e-3 * (self.model.sensor.dead_time.dead_time_s or 1e-7
                           if name == "dead time" else 1.0)  # fmt: skip
            moved[at] += step
            found.append((self.change(names, moved) - base) / step)
        return np.array(found).T
