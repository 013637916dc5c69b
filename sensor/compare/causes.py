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
those of as many that do nearly as well are told. Predicted changes are allowed an error of
`MODEL_ERROR`, those of covariances, which are first-order, of three times as much.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations, pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.ndimage import convolve
from scipy.stats import chi2, f, norm

from megalopta.core.arrays import Floats, Ints, Mask
from megalopta.sensor.calibrate.level import Level, inverses
from megalopta.sensor.change import changed
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
_AS_GOOD = 9.0
"""Difference of χ² up to which two explanations are equally good."""
_ERRORS = {"M": 2e-3, "V": 5e-3, "K": 1e-2}
"""Relative errors of expected features that are forgiven to the model."""
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
    used = [number for number, pixels in enumerate(good) if pixels.sum() > 1]
    values, covariances = [np.zeros(0)], []
    for number in used:
        readings = recordings[number].signal
        edges = np.linspace(0, len(readings), BLOCKS + 1).astype(int)
        frames = (np.asarray(readings[start:end], np.float32) for start, end in pairwise(edges))
        blocks = np.array([_of_frames(part, good[number], has_comb[number]) for part in frames])
        values.append(blocks.mean(axis=0))
        covariances.append(np.cov(blocks.T) * len(readings) / BLOCKS)
    level = np.repeat(np.array(used, np.int64), [3 + has_comb[number] for number in used])
    return Features(
        np.concatenate(values),
        block_diag(*covariances),
        np.array([len(recordings[number].readings) for number in level.tolist()], np.int64),
        level,
        np.array([kind for number in used for kind in "MVCK"[: 3 + has_comb[number]]], np.str_),
    )


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


@dataclass(frozen=True, eq=False, kw_only=True)
class Cause:
    """Parameter of the device that may differ."""

    name: str
    unit: str
    expected: float
    """Value of the known device"""
    signature: Callable[[float], Floats | float]
    """Change of all features by a change of the parameter; 0 of the step, which multiplies them"""
    is_relative: bool = False
    """True if changes are relative to the expected value"""
    is_square: bool = False
    """True if changes are those of the parameter's square"""
    least: float = 0.0
    """Differences are relative to the expected value, or to this if larger"""
    lowest: float = -0.95
    """Smallest change that is possible"""
    small: float = 1e-3
    """Change over which slopes are taken"""

    def value(self, size: float) -> float:
        """Return the parameter after a change."""
        if self.is_square:
            return float(np.sqrt(max(self.expected**2 + size, 0.0)))
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


@dataclass(frozen=True, eq=False)
class _Expected:
    """Levels of the known device, and their features."""

    features: Features
    levels: Sequence[Residual]
    means: Sequence[Floats]
    """Mean counts of the good pixels of each level"""

    def change(self, causes: Sequence[Cause], sizes: Floats) -> Floats:
        """Return the predicted change of features."""
        features = self.features
        total, gain = np.zeros_like(features.values), 1.0
        for cause, size in zip(causes, sizes, strict=True):
            total = total + cause.signature(float(size))
            gain *= 1 + float(size) if cause.name == "step" else 1.0
        if gain == 1:
            return total
        # means by the step, variances by its square
        power = np.select([features.kind == "M", features.kind != "K"], [1, 2])
        total = total * gain**power + features.values * (gain**power - 1)
        for at in np.flatnonzero(features.kind == "K"):  # Poisson counts, by a wrong step
            mean = self.means[features.level[at]]
            blur = np.exp(-2 * mean * (1 - np.cos(2 * np.pi * (gain - 1))))
            total[at] += features.values[at] * (float(blur.mean()) - 1)
        return total

    def slopes(self, causes: Sequence[Cause], sizes: Floats, base: Floats) -> Floats:
        """Return the derivatives (F, causes) of the predicted change, which is `base`."""
        slopes = []
        for at, cause in enumerate(causes):
            moved = sizes.copy()
            moved[at] += cause.small
            slopes.append((self.change(causes, moved) - base) / cause.small)
        return np.array(slopes).T

    def of_events(
        self, parameter: str, step: float, is_linear: bool = False
    ) -> Callable[[float], Floats]:
        """Return the signature of a parameter that changes the moments of events.

        By their closed forms: a parabola through two changes of about the size, in powers of two of
        a step, or a line, as tables of afterpulses take seconds.
        """

        @cache
        def parabola(step: float) -> tuple[Floats, Floats]:
            first = self._moved(parameter, step)
            second = 2 * first if is_linear else self._moved(parameter, 2 * step)
            return (4 * first - second) / (2 * step), (second - 2 * first) / (2 * step**2)

        def signature(size: float) -> Floats:
            width, widest = step, step if is_linear else 8 * step
            while abs(size) > 2.5 * width and width < widest:
                width *= 2
            slope, bend = parabola(width)
            return slope * size + bend * size**2

        return signature

    def _moved(self, parameter: str, size: float) -> Floats:
        """Change of the features by the closed forms of events."""
        features = self.features
        moved = np.zeros_like(features.values)
        for number in np.unique(features.level):
            level, is_of_level = self.levels[number], features.level == number
            model, good, exposure_s = level.model, level.good, level.expected.exposure_s
            before = model.moments(exposure_s, level.light_hz)
            after = model.moments(exposure_s, level.light_hz, parameter, size)
            for kind, unchanged, changed_ in zip("MV", before, after, strict=True):
                change = float((changed_ - unchanged)[good].mean())
                moved[is_of_level & (features.kind == kind)] = change
            if parameter == "crosstalk":
                variance = float(before[1][good].mean())
                share = _coincidences(size, level)
                moved[is_of_level & (features.kind == "C")] = variance * share
        return moved


def _coincidences(neighbors: float, level: Residual) -> float:
    """Covariance with the right and lower neighbor over the variance, by crosstalk."""
    good, parts = level.good, level.parts
    crosstalk = changed(level.model.sensor.crosstalk, mean_fired_neighbors=0.1)
    weights = neighborhoods(crosstalk).mean(axis=(0, 1))
    # each of four nearest neighbors gets a share; both directions of a pair covary
    beside = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]])
    middle = tuple(np.array(weights.shape) // 2)
    nearest = convolve(weights, beside, mode="constant")[middle]
    share = neighbors * nearest / 4 / weights.sum()
    pairs = (good[:, :-1] & good[:, 1:]).sum() + (good[:-1] & good[1:]).sum()
    # of avalanches that crosstalk adds, dead time leaves as many as of more light
    added = (parts["efficiency"] + parts["dark counts"])[good].sum()
    counted = float(added / max(parts["step"][good].sum(), 1e-300))
    return float(2 * share * counted * pairs / good.sum())


def _causes_of(expected: _Expected) -> tuple[Cause, ...]:
    levels, features = expected.levels, expected.features
    model = levels[0].model
    sensor = model.sensor
    efficiencies = [
        float(level.light_hz[level.good].mean()) / level.expected.light_hz
        for level in levels
        if level.good.any() and level.expected.light_hz
    ]
    dark_pixels = next((level.good for level in levels if level.good.any()), levels[0].good)
    dead_s, carriers = sensor.dead_time.dead_time_s, sensor.afterpulsing.mean_carriers
    neighbors, read_noise = sensor.crosstalk.mean_fired_neighbors, 0.0
    if isinstance(sensor.counter, AnalogCounter):  # with rounding by the ADC
        rounding_v = sensor.counter.lsb_v / 12**0.5
        read_noise = float(
            np.hypot(sensor.counter.read_noise_v, rounding_v) / sensor.counter.step_v
        )

    def noisier(variance: float) -> Floats:
        clearness = np.expm1(np.clip(-4 * np.pi**2 * variance, -50, 1))
        kinds = [features.kind == "V", features.kind == "K"]
        return np.select(kinds, [variance, features.values * clearness])

    causes = (
        Cause(
            name="dark counts", unit="Hz", expected=model.dark_hz(dark_pixels), is_relative=True,
            signature=expected.of_events("dark counts", 0.1),
        ),
        Cause(
            name="efficiency", unit="events per photon", is_relative=True,
            expected=efficiencies[0] if efficiencies else 0.0,
            signature=expected.of_events("efficiency", 0.1),
        ),
        Cause(
            name="dead time", unit="s", expected=dead_s, least=1e-9, lowest=-dead_s,
            small=1e-3 * (dead_s or 1e-7),
            signature=expected.of_events("dead time", 0.1 * max(dead_s, 1e-7)),
        ),
        Cause(  # frames do not show the delay, which is assumed
            name="afterpulsing", expected=carriers, least=0.02, lowest=-carriers,
            unit=f"carriers per event at a delay of {1e6 * model.delay_s:.3g} µs",
            signature=expected.of_events("afterpulsing", 0.05, is_linear=True),
        ),
        Cause(
            name="crosstalk", unit="neighbors per event", expected=neighbors, least=0.02,
            lowest=-neighbors, signature=expected.of_events("crosstalk", 0.02),
        ),
        Cause(name="step", unit="counts per event", expected=1.0, signature=lambda _: 0.0),
        Cause(
            name="offset", unit="counts", expected=0.0, least=1.0, lowest=-20.0,
            signature=lambda counts: np.where(features.kind == "M", counts, 0),
        ),
        Cause(
            name="read noise", unit="counts", expected=read_noise, least=0.05, lowest=-1.0,
            is_square=True, signature=noisier,
        ),
    )  # fmt: skip
    unseen = set() if any(level.expected.light_hz for level in levels) else {"efficiency"}
    if levels[0].expected.codes is None:
        unseen |= {"offset", "read noise"}
    return tuple(cause for cause in causes if cause.name not in unseen)


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
    levels: Sequence[Residual], *, margin: float, calibration: dict[str, float]
) -> Causes:
    """Fit the parameters of a device to captured and expected levels and their good pixels.

    `calibration` is the uncertainty that all levels share.
    """
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
    captured = features([level.captured for level in levels], good, has_comb)
    known = features([level.expected for level in levels], good, has_comb)
    if not known.values.size:
        return Causes()
    means = [
        np.asarray(level.expected.signal.mean(axis=0))[pixels].clip(0)
        for level, pixels in zip(levels, good, strict=True)
    ]
    expected = _Expected(known, levels, means)
    causes = _causes_of(expected)
    # in recordings of one device, covariances of single frames are equal
    frames = 1 / captured.frames + 1 / known.frames
    counted = (captured.covariance + known.covariance) / 2 * frames
    # fluctuations of levels, and the calibration
    doubted = np.zeros_like(counted)
    is_squared = (known.kind == "V") | (known.kind == "C")
    doubts = [(known.level == number, level.uncertainty) for number, level in enumerate(levels)]
    for is_of_level, uncertainty in (*doubts, (known.level >= 0, calibration)):
        doubted += np.diag((uncertainty.get("variance", 0.0) * (is_of_level & is_squared)) ** 2)
        for cause in causes:
            if size := uncertainty.get(cause.name, 0.0):
                moved = np.where(is_of_level, expected.change([cause], np.array([size])), 0.0)
                doubted += np.outer(moved, moved)
    fit = _Fit(captured.values - known.values, counted, doubted, expected)
    p = fit.explained(()).p
    # errors of the model are forgiven
    off = np.select([known.kind == kind for kind in _ERRORS], list(_ERRORS.values()))
    common = np.array([means[level].mean() for level in known.level])
    off = np.where(known.kind == "C", 1e-3 * common, off * np.abs(known.values))
    fit = fit._replace(doubted=doubted + np.diag(off**2))
    p_forgiven = fit.explained(()).p
    # smallest sets of causes that are not refuted, the best first
    accepted: list[Explanation] = []
    for many in (1, 2) if p_forgiven < FALSE_ALARMS else ():
        fits = [fit.explained(subset) for subset in combinations(causes, many)]
        accepted = sorted((e for e in fits if e.p > REFUTED), key=lambda e: e.chi_square)
        if accepted:
            break
    accepted = [e for e in accepted if e.chi_square - accepted[0].chi_square < _AS_GOOD]
    names = accepted[0].names if accepted else ()
    chosen = tuple(cause for name in names for cause in causes if cause.name == name)
    alone = []
    for cause in causes:
        fitted = chosen if cause in chosen else (*chosen, cause)
        explanation, at = fit.explained(fitted), fitted.index(cause)
        size, error = float(explanation.sizes[at]), float(explanation.errors[at])
        alone.append(cause.difference(size, error, margin))
    return Causes(p, p_forgiven, tuple(accepted), tuple(alone))


class _Fit(NamedTuple):
    """Difference of features, and its covariance by counting and by doubts."""

    difference: Floats
    counted: Floats
    doubted: Floats
    expected: _Expected

    def explained(self, causes: tuple[Cause, ...]) -> Explanation:
        """Fit the sizes of some causes."""
        sizes, errors = np.zeros(len(causes)), np.zeros(len(causes))
        lowest = np.array([cause.lowest for cause in causes])
        doubted, covariance = self.doubted, self.counted + self.doubted
        for _ in range(12 if causes else 0):
            base = self.expected.change(causes, sizes)
            is_covariance = self.expected.features.kind == "C"
            error = np.where(is_covariance, 3 * MODEL_ERROR, MODEL_ERROR) * np.abs(base)
            doubted = self.doubted + np.diag(error**2)
            covariance = self.counted + doubted
            slopes = self.expected.slopes(causes, sizes, base)
            weighted = inverses(covariance, _SMALLEST) @ slopes
            normal = np.linalg.pinv(slopes.T @ weighted, hermitian=True)
            step = normal @ (weighted.T @ (self.difference - base))
            sizes = np.clip(sizes + np.clip(step, -1, 1), lowest, 20.0)
        change = self.expected.change(causes, sizes)
        left = self.difference - change
        if causes:
            slopes = self.expected.slopes(causes, sizes, change)
            information = slopes.T @ inverses(covariance, _SMALLEST) @ slopes
            errors = np.sqrt(np.diag(np.linalg.pinv(information, hermitian=True)).clip(0))
        # the χ² of each level has the chance of its T²
        known, freedom, blocks = np.zeros_like(self.counted), 0, 2 * (BLOCKS - 1)
        for number in np.unique(self.expected.features.level):
            is_of_level = self.expected.features.level == number
            block = np.ix_(is_of_level, is_of_level)
            inverse = inverses(self.counted[block], _SMALLEST)
            size = int(np.linalg.matrix_rank(inverse))
            t_square = float(left[is_of_level] @ inverse @ left[is_of_level])
            freedom_left = blocks - size + 1
            chance = 1.0
            if size:
                chance = f.sf(t_square * freedom_left / (blocks * size), size, freedom_left)
            square = chi2.isf(max(chance, 1e-290), size) if size else 0.0
            known[block] = self.counted[block] * (t_square / square if square > 0 else 1.0)
            freedom += size
        square = float(left @ inverses(known + doubted, _SMALLEST) @ left)
        freedom = max(freedom - len(causes), 1)
        names = tuple(cause.name for cause in causes)
        return Explanation(names, sizes, errors, square, float(chi2.sf(square, freedom)))
