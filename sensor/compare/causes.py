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

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import combinations, pairwise
from typing import Literal, NamedTuple

import numpy as np
from scipy.linalg import block_diag
from scipy.ndimage import convolve
from scipy.stats import chi2, f, norm

from megalopta.core.arrays import Floats, Ints, Mask
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.change import changed
from megalopta.sensor.compare.model import Change, Uncertainty
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
        return np.array([feature == kind for feature in self.kind])


def features(
    levels: Sequence[Residual], side: Literal["captured", "expected"], has_comb: Sequence[bool]
) -> Features:
    """Return the features of the good pixels of captured or expected frames of all levels."""
    values, covariances, places, frames = [], [], [], []
    kinds: list[str] = []
    for number, (level, comb) in enumerate(zip(levels, has_comb, strict=True)):
        recording: Level = getattr(level, side)
        good = level.good
        if good.sum() < 2:
            continue
        names = ("M", "V", "C", "K") if comb else ("M", "V", "C")
        edges = np.linspace(0, len(recording.readings), BLOCKS + 1).astype(int)
        blocks = np.array(
            [
                _of_frames(np.asarray(recording.signal[first:end], np.float32), good, comb)
                for first, end in pairwise(edges)
            ]
        )
        values.append(blocks.mean(axis=0))
        covariances.append(np.cov(blocks.T) * len(recording.readings) / BLOCKS)
        places += [number] * len(names)
        frames += [len(recording.readings)] * len(names)
        kinds += names
    if not values:
        return Features(np.zeros(0), np.zeros((0, 0)), np.zeros(0, int), np.zeros(0, int), ())
    total = block_diag(*covariances)
    return Features(np.concatenate(values), total, np.array(frames), np.array(places), tuple(kinds))


def _of_frames(signal: Floats, good: Mask, comb: bool) -> Floats:
    n = len(signal)
    mean = signal.mean(axis=0, dtype=np.float64)
    noise = np.where(good, signal - mean, 0)
    variance = np.square(noise).sum(axis=0) / (n - 1)
    near = (noise[:, :, :-1] * noise[:, :, 1:]).sum() + (noise[:, :-1] * noise[:, 1:]).sum()
    values = [mean[good].mean(), variance[good].mean(), near / (n - 1) / good.sum()]
    if comb:
        wave = np.exp(2j * np.pi * signal[:, good]).mean(axis=0)
        values.append(((n * np.square(np.abs(wave)) - 1) / (n - 1)).mean())
    return np.array(values, np.float64)


@dataclass(frozen=True, eq=False, kw_only=True)
class Cause:
    """A parameter of the device that may differ."""

    name: str
    parameter: str = ""
    """Field of `Uncertainty`"""
    unit: str
    expected: float
    """Value of the known device"""
    signature: Callable[[float], Floats | float] = lambda _: 0.0
    """Returns the change of all features by a change of the parameter"""
    is_gain: bool = False
    """True if a change multiplies all counts by 1 more than itself"""
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
            gain *= 1 + float(size) if cause.is_gain else 1.0
        if gain == 1:
            return total
        power = np.select([features.of("M"), features.of("V") | features.of("C")], [1, 2])
        total = total * gain**power + features.values * (gain**power - 1)
        for at in np.flatnonzero(features.of("K")):  # the comb of Poisson counts, by a wrong step
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


@dataclass(frozen=True, eq=False, kw_only=True)
class _OfEvents:
    """Signature of a parameter that changes the moments of events, by their closed forms."""

    expected: _Expected
    parameter: str
    """Field of `Change`"""
    step: float
    """Change through which, and twice which, a parabola is laid"""
    is_linear: bool = False
    """True if one change has to do: tables of afterpulses take seconds"""
    parabolas: dict[float, tuple[Floats, Floats]] = field(default_factory=dict)
    """Slope and curvature of the features, by the step"""

    def __call__(self, size: float) -> Floats:
        """Return the change by a parabola through two changes of about this size."""
        step = self.step
        largest = 0.0 if self.is_linear else _LARGEST_STEP * self.step
        while abs(size) > 2.5 * step and step < largest:
            step *= 2
        if step not in self.parabolas:
            first = self._moved(step)
            second = 2 * first if self.is_linear else self._moved(2 * step)
            slope, bend = (4 * first - second) / (2 * step), (second - 2 * first) / (2 * step**2)
            self.parabolas[step] = slope, bend
        slope, bend = self.parabolas[step]
        return slope * size + bend * size**2

    def _moved(self, size: float) -> Floats:
        features = self.expected.features
        moved = np.zeros_like(features.values)
        for number, level in enumerate(self.expected.levels):
            is_of_level = features.level == number
            if not is_of_level.any():
                continue
            model, good, exposure_s = level.model, level.good, level.expected.exposure_s
            before, after = (
                model.moments(exposure_s, level.light_hz, change)
                for change in (Change(), Change(**{self.parameter: size}))
            )
            for kind, unchanged, changed_ in zip("MV", before, after, strict=True):
                moved[is_of_level & features.of(kind)] = float((changed_ - unchanged)[good].mean())
            if self.parameter == "neighbors":
                variance = float(before[1][good].mean())
                moved[is_of_level & features.of("C")] = variance * _coincidences(size, level, good)
        return moved


def _coincidences(neighbors: float, level: Residual, good: Mask) -> float:
    """Covariance with the right and lower neighbor over the variance, by crosstalk."""
    crosstalk = changed(level.model.sensor.crosstalk, mean_fired_neighbors=0.1)
    weights = neighborhoods(crosstalk).mean(axis=(0, 1))
    # each of four nearest neighbors gets a share; both directions of a pair covary
    nearest = convolve(weights, _CROSS, mode="constant")[tuple(np.array(weights.shape) // 2)]
    share = neighbors * nearest / 4 / weights.sum()
    pairs = (good[:, :-1] & good[:, 1:]).sum() + (good[:-1] & good[1:]).sum()
    # of avalanches that crosstalk adds, dead time leaves as many as of more light
    parts = level.parts
    counted = float((parts.light + parts.dark)[good].sum() / max(parts.mean[good].sum(), 1e-300))
    return float(2 * share * counted * pairs / good.sum())


def _causes_of(expected: _Expected) -> tuple[Cause, ...]:
    """All causes that recordings can show."""
    levels, features = expected.levels, expected.features
    model = levels[0].model
    sensor = model.sensor
    good = [level.good for level in levels]
    lit = [
        float(level.light_hz[pixels].mean()) / level.expected.light_hz
        for level, pixels in zip(levels, good, strict=True)
        if pixels.any() and level.expected.light_hz
    ]
    dead_s, carriers = sensor.dead_time.dead_time_s, sensor.afterpulsing.mean_carriers
    neighbors = sensor.crosstalk.mean_fired_neighbors

    def of_events(parameter: str, step: float, is_linear: bool = False) -> _OfEvents:
        return _OfEvents(expected=expected, parameter=parameter, step=step, is_linear=is_linear)

    causes = [
        Cause(
            name="dark counts", parameter="dark_counts", unit="Hz", is_relative=True,
            expected=model.dark_hz(next((pixels for pixels in good if pixels.any()), good[0])),
            signature=of_events("dark_counts", 0.1),
        ),
        Cause(
            name="efficiency", parameter="efficiency", unit="events per photon", is_relative=True,
            expected=lit[0] if lit else 0.0, signature=of_events("efficiency", 0.1),
        ),
        Cause(
            name="dead time", unit="s", expected=dead_s, least=1e-9, lowest=-dead_s,
            small=1e-3 * (dead_s or 1e-7),
            signature=of_events("dead_time_s", 0.1 * max(dead_s, 1e-7)),
        ),
        Cause(  # frames do not show the delay, which is assumed
            name="afterpulsing", expected=carriers, least=0.02, lowest=-carriers,
            unit=f"carriers per event at a delay of {1e6 * model.delay_s:.3g} µs",
            signature=of_events("carriers", 0.05, is_linear=True),
        ),
        Cause(
            name="crosstalk", unit="neighbors per event", expected=neighbors, least=0.02,
            lowest=-neighbors, signature=of_events("neighbors", 0.02),
        ),
        Cause(name="step", parameter="step", unit="counts per event", expected=1.0, is_gain=True),
    ]  # fmt: skip
    if not any(level.expected.light_hz for level in levels):
        del causes[1]
    if levels[0].expected.codes is None:
        return tuple(causes)
    counter, noise = sensor.counter, 0.0
    if isinstance(counter, AnalogCounter):  # with rounding by the ADC
        noise = float(np.hypot(counter.read_noise_v, counter.lsb_v / 12**0.5) / counter.step_v)

    def noisier(variance: float) -> Floats:
        clearness = np.expm1(np.clip(-4 * np.pi**2 * variance, -50, 1))
        return np.select(
            [features.of("V"), features.of("K")], [variance, features.values * clearness]
        )

    return (
        *causes,
        Cause(
            name="offset", parameter="offset", unit="counts", expected=0.0, least=1.0,
            lowest=-20.0, signature=lambda counts: np.where(features.of("M"), counts, 0),
        ),
        Cause(
            name="read noise", parameter="read_noise", unit="counts", expected=noise, least=0.05,
            lowest=-1.0, is_square=True, signature=noisier,
        ),
    )  # fmt: skip


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


def find_causes(levels: Sequence[Residual], *, margin: float, calibration: Uncertainty) -> Causes:
    """Fit the parameters of a device to captured and expected levels and their good pixels.

    `calibration` is the uncertainty that all levels share.
    """
    has_comb = [
        # what was subtracted has moved the peaks
        _has_comb(level) and not any(level.uncertainty._replace(read_noise=0.0))
        for level in levels
    ]
    captured, known = (
        features(levels, "captured", has_comb),
        features(levels, "expected", has_comb),
    )
    if not known.values.size:
        return Causes()
    means = [np.asarray(level.expected.signal.mean(axis=0))[level.good].clip(0) for level in levels]
    expected = _Expected(known, levels, means)
    causes = _causes_of(expected)
    # in recordings of one device, covariances of single frames are equal
    frames = 1 / captured.frames + 1 / known.frames
    counted = (captured.covariance + known.covariance) / 2 * frames
    # fluctuations of levels, and the calibration
    doubted = np.zeros_like(counted)
    is_squared = known.of("V") | known.of("C")
    for number, level in enumerate([*levels, None]):
        uncertainty = calibration if level is None else level.uncertainty
        is_of_level = np.full(len(doubted), True) if level is None else known.level == number
        doubted += np.diag((uncertainty.variance * (is_of_level & is_squared)) ** 2)
        for cause in causes:
            size = getattr(uncertainty, cause.parameter) if cause.parameter else 0.0
            if size:
                moved = np.where(is_of_level, expected.change([cause], np.array([size])), 0.0)
                doubted += np.outer(moved, moved)
    fit = _Fit(captured.values - known.values, counted, doubted, expected)
    p = fit.explained(()).p
    # errors of the model are forgiven
    off = np.select([known.of(kind) for kind in _ERRORS], list(_ERRORS.values()))
    common = np.array([means[level].mean() for level in known.level])
    off = np.where(known.of("C"), _COMMON_ERROR * common, off * np.abs(known.values))
    fit = fit._replace(doubted=doubted + np.diag(off**2))
    p_forgiven = fit.explained(()).p
    accepted = _accepted(fit, causes) if p_forgiven < FALSE_ALARMS else ()
    names = accepted[0].names if accepted else ()
    chosen = tuple(cause for name in names for cause in causes if cause.name == name)
    alone = []
    for cause in causes:
        fitted = chosen if cause in chosen else (*chosen, cause)
        explanation, at = fit.explained(fitted), fitted.index(cause)
        size, error = float(explanation.sizes[at]), float(explanation.errors[at])
        alone.append(cause.difference(size, error, margin))
    return Causes(p, p_forgiven, accepted, tuple(alone))


def _has_comb(level: Residual) -> bool:
    good = level.good
    if level.expected.codes is None or not good.any():
        return False
    signal = np.asarray(level.expected.signal, np.float32)[:, good]
    if float(signal.mean()) > _FEW_COUNTS:
        return False
    n = len(signal)
    power = np.square(np.abs(np.exp(2j * np.pi * signal).mean(axis=0)))
    return float(((n * power - 1) / (n - 1)).mean()) > _FAINT


def _accepted(fit: "_Fit", causes: Sequence[Cause]) -> tuple[Explanation, ...]:
    """Smallest sets of causes that are not refuted, the best first."""
    for many in range(1, _MOST + 1):
        fits = [fit.explained(subset) for subset in combinations(causes, many)]
        held = sorted((e for e in fits if e.p > REFUTED), key=lambda e: e.chi_square)
        if held:
            return tuple(e for e in held if e.chi_square - held[0].chi_square < _AS_GOOD)
    return ()


def _inverse(covariance: Floats) -> Floats:
    """Inverse of a covariance matrix, for entries of any unit; 0 where nothing varies."""
    sigma = np.sqrt(np.diagonal(covariance))
    scale = np.divide(1, sigma, out=np.zeros_like(sigma), where=sigma > 0)
    inverse = np.linalg.pinv(scale[:, None] * covariance * scale, rcond=1e-10, hermitian=True)
    return np.asarray(scale[:, None] * inverse * scale)


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
        for _ in range(_ROUNDS if causes else 0):
            base = self.expected.change(causes, sizes)
            is_common = self.expected.features.of("C")
            error = np.where(is_common, 3 * MODEL_ERROR, MODEL_ERROR) * np.abs(base)
            doubted = self.doubted + np.diag(error**2)
            covariance = self.counted + doubted
            slopes = self.expected.slopes(causes, sizes, base)
            weighted = _inverse(covariance) @ slopes
            normal = np.linalg.pinv(slopes.T @ weighted, hermitian=True)
            step = normal @ (weighted.T @ (self.difference - base))
            sizes = np.clip(sizes + np.clip(step, -1, 1), lowest, 20.0)
        change = self.expected.change(causes, sizes)
        left = self.difference - change
        if causes:
            slopes = self.expected.slopes(causes, sizes, change)
            information = slopes.T @ _inverse(covariance) @ slopes
            errors = np.sqrt(np.diag(np.linalg.pinv(information, hermitian=True)).clip(0))
        # the χ² of each level has the chance of its T²
        known, freedom, blocks = np.zeros_like(self.counted), 0, 2 * (BLOCKS - 1)
        for number in np.unique(self.expected.features.level):
            is_of_level = self.expected.features.level == number
            block = np.ix_(is_of_level, is_of_level)
            inverse = _inverse(self.counted[block])
            size = int(np.linalg.matrix_rank(inverse))
            t_square = float(left[is_of_level] @ inverse @ left[is_of_level])
            freedom_left = blocks - size + 1
            chance = 1.0
            if size:
                chance = f.sf(t_square * freedom_left / (blocks * size), size, freedom_left)
            square = chi2.isf(max(chance, 1e-290), size) if size else 0.0
            known[block] = self.counted[block] * (t_square / square if square > 0 else 1.0)
            freedom += size
        square = float(left @ _inverse(known + doubted) @ left)
        freedom = max(freedom - len(causes), 1)
        names = tuple(cause.name for cause in causes)
        return Explanation(names, sizes, errors, square, float(chi2.sf(square, freedom)))
