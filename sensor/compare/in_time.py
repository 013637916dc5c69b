"""Steadiness in time: repeated and missing frames, drift, flicker, banding, common noise.

Readings of a pixel are standardized, z = (x − mean)/σ, so that no bright or noisy pixel dominates.
Without common fluctuations the mean of z over N pixels has the variance 1/N in every frame, and its
periodogram is exponential.

    repeated frames    frames equal to the one before, more than in the expected recording
    missing frames     gaps in the times of frames
    drift              second half against the first (`calibrate.level`)
    flicker            line in the periodogram of the mean of z
    banding            line in periodograms of the means of rows, less that of all
    row, column noise  correlation of pixels of one line, four or more pixels apart
    dependent frames   correlation of all pixels with the frame before, as by image lag or a running
                       mean, beyond that of the expected recording

Drift of the light leaves darkness unchanged. Drift of the gain is in proportion to all counts, of
the dark counts in proportion to these, and of the offset the same in every recording. The amplitude
that fits all recordings names the cause; if none fits clearly, no cause is named.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import gamma, norm

from megalopta.core.arrays import Floats, Ints, Mask
from megalopta.sensor.calibrate.level import Drift, Level, drift
from megalopta.sensor.compare.faults import Fault
from megalopta.sensor.compare.model import Parts, Unsure, Varying

_CHANCE = 1e-6
"""Chance of a false line, or repetition, in one recording."""
_DRIFT_Z = 5.0
_SMALLEST_DRIFT = 0.01
_CLEARLY_BETTER = 16.0
_MOST_LINES = 3
_MOST_LOST = 4
"""Frames made over frames kept above which times are not used."""
_FEWEST_FRAMES, _FEWEST_PIXELS = 16, 16
_FEWEST_COUNTS = 30.0
_OF_MEDIAN = 1.2533
"""Standard error of a median over that of a mean"""
_SMALLEST_MEMORY = 0.01
"""Correlation with the frame before that is negligible"""
_LOWEST_LINE = 3
"""Cycles per recording below which a line is a drift."""
_OF_ROWS = 0.2
"""Power of rows relative to that of all pixels above which a line is banding."""
_FAR = 4
_NOISE_Z = 6.0
_LEFT = 0.2
"""Share of the variance of a removed fluctuation that may be left."""
_SMALLEST_SHARE = 5e-4
"""Share of the variance of a pixel below which common noise is negligible."""


class Residuals(NamedTuple):
    """Standardized readings of good pixels."""

    z: Floats
    """Readings less their mean, over their σ (n, rows, columns); 0 for other pixels"""
    sigma: Floats
    """(rows, columns)"""
    varies: Mask
    """Good pixels that vary"""

    @classmethod
    def of(cls, signal: NDArray[Any], good: Mask) -> "Residuals":
        """Standardize readings (n, rows, columns)."""
        signal = np.asarray(signal, np.float32)
        sigma = signal.std(axis=0)
        varies = good & (sigma > 0)
        z = np.asarray((signal - signal.mean(axis=0)) / np.where(varies, sigma, np.inf))
        return cls(z, sigma, varies)

    @property
    def mean(self) -> Floats:
        """Mean of z over the pixels that vary, (n,)."""
        return np.asarray(self.z.sum(axis=(1, 2)) / max(int(self.varies.sum()), 1), np.float64)

    def reach(self, change: Floats) -> float:
        """Return the change of the mean of z if counts change by this map."""
        varies = self.varies
        return float((change[varies] / self.sigma[varies]).mean()) if varies.any() else 0.0

    def far_correlation(self) -> tuple[float, float]:
        """Return the mean correlation of pixels at least four rows apart, and its error."""
        sums, pixels = self.z.sum(axis=2), self.varies.sum(axis=1)
        products, pairs = np.zeros(len(sums)), 0.0
        for row in range(sums.shape[1] - _FAR):
            products += sums[:, row] * sums[:, row + _FAR :].sum(axis=1)
            pairs += float(pixels[row] * pixels[row + _FAR :].sum())
        return _mean_and_error(products, pairs)

    def line_correlation(self, name: str) -> tuple[float, float]:
        """Return the mean correlation of pixels of one "row" or "column", four or more apart."""
        z = self.z if name == "row" else self.z.swapaxes(1, 2)
        varies = (self.varies if name == "row" else self.varies.T).astype(float)
        if z.shape[2] <= _FAR:
            return 0.0, np.inf
        later = np.cumsum(z[:, :, ::-1], axis=2)[:, :, ::-1]
        number = np.cumsum(varies[:, ::-1], axis=1)[:, ::-1]
        products = (z[:, :, :-_FAR] * later[:, :, _FAR:]).sum(axis=(1, 2))
        return _mean_and_error(products, float((varies[:, :-_FAR] * number[:, _FAR:]).sum()))


def _mean_and_error(products: Floats, pairs: float) -> tuple[float, float]:
    if not pairs:
        return 0.0, np.inf
    values = products / pairs
    return float(values.mean()), float(values.std(ddof=1) / np.sqrt(len(values)))


@dataclass
class Steadied:
    """A level without its common fluctuations."""

    level: Level
    good: Mask
    parts: Parts
    unsure: Unsure = field(default_factory=Unsure)
    faults: list[Fault] = field(default_factory=list)

    @property
    def residuals(self) -> Residuals:
        """Standardized readings."""
        return Residuals.of(self.level.signal, self.good)

    @property
    def moving(self) -> Varying:
        """Light or the output, which a common fluctuation moves most probably."""
        if not self.level.is_dark:
            return Varying.LIGHT
        return Varying.GAIN if self.level.codes is None else Varying.OFFSET

    def subtract(self, change: Floats) -> None:
        """Subtract counts (n, rows, columns) from the level."""
        level = self.level
        signal = np.asarray(level.signal - change, np.float32)
        if level.unrounded is None:
            self.level = replace(level, readings=signal)
            return
        moved = np.rint(signal.clip(0)) - np.rint(np.asarray(level.unrounded).clip(0))
        readings = np.maximum(level.readings + moved, 0)
        self.level = replace(level, unrounded=signal, readings=readings)

    def note(self, kind: str, text: str) -> None:
        """Note a fault."""
        self.faults.append(Fault(kind, text))


def without_repeats(captured: Level, expected: Level) -> tuple[Level, list[Fault]]:
    """Remove frames that repeat the one before, if these are more than expected."""
    same, usual = (
        np.array(
            [
                # not all dark or all saturated
                np.array_equal(one, other) and np.ptp(one) > 0
                for one, other in pairwise(level.recorded.reshape(len(level.readings), -1))
            ]
        )
        for level in (captured, expected)
    )
    # Laplace's rule: no repetition seen does not exclude one
    rate = (usual.mean() * len(expected.readings) + 1) / (len(expected.readings) + 2)
    z = (same.mean() - rate) / np.sqrt(rate * (1 - rate) / same.size)
    if not (z > norm.isf(_CHANCE) and same.sum() > 1):
        return captured, []
    text = f"{same.sum()} of {same.size + 1} frames repeat the one before"
    return captured.at(np.append(True, ~same)), [Fault("repeated frames", text)]


def dependent_frames(captured: Level, expected: Level, good: Mask) -> list[Fault]:
    """Return correlation with the frame before that most pixels share, beyond what is expected."""
    memories = []
    for level in (captured, expected):
        # beside what the pixels of a row share
        z = Residuals.of(level.signal, good).z
        shared = z.mean(axis=2, keepdims=True)
        z = z - shared * (z * shared).sum(axis=0) / np.maximum(np.square(shared).sum(axis=0), 1e-30)
        power = np.square(z).sum(axis=0)
        tested = good & (power > 0) & (level.signal.sum(axis=0, dtype=np.float64) > _FEWEST_COUNTS)
        memories.append(((z[1:] * z[:-1]).sum(axis=0) / np.maximum(power, 1e-30))[tested])
    if min(memory.size for memory in memories) < _FEWEST_PIXELS:
        return []
    share = float(np.median(memories[0]) - np.median(memories[1]))
    readings = len(captured.readings) * memories[0].size, len(expected.readings) * memories[1].size
    error = _OF_MEDIAN * np.sqrt(1 / readings[0] + 1 / readings[1])
    if abs(share) < max(_NOISE_Z * error, _SMALLEST_MEMORY):
        return []
    text = (
        f"readings of all pixels are correlated by {share:.2g} with those of the frame before, so "
        "that neither parameters nor pixels are tested"
    )
    return [Fault("dependent frames", text)]


def missing_frames(level: Level) -> list[Fault]:
    """Return the gaps in the times of frames."""
    if level.times_s is None or len(level.times_s) < 3:
        return []
    missing = np.rint(np.diff(level.times_s) / level.interval_s) - 1
    places = int((missing > 0).sum())
    if not places:
        return []
    where = "in one place" if places == 1 else f"in {places} places"
    text = f"{missing[missing > 0].sum():.0f} frames are missing {where}"
    return [Fault("missing frames", text)]


def steadied(
    levels: Sequence[Level], good: Sequence[Mask], parts: Sequence[Parts]
) -> list[Steadied]:
    """Remove the common fluctuations of levels.

    `good` are the usable pixels of each level, and `parts` their expected counts.
    """
    found = [Steadied(*each) for each in zip(levels, good, parts, strict=True)]
    _remove_drifts(found)
    for each in found:
        _remove_lines(each)
        residuals, change = each.residuals, each.parts.shape_of(each.moving)
        total, error = residuals.far_correlation()
        if total > _NOISE_Z * error and total > _SMALLEST_SHARE:
            reach = max(residuals.reach(change), 1e-12)
            size = float(np.sqrt(total)) / reach
            each.subtract((residuals.mean / reach)[:, None, None] * change)
            _doubt(each, size / np.sqrt(len(residuals.z)), 2 * size * _mean_of(each))
            amount = _amount(each.moving, size)
            each.note("common noise", f"all pixels fluctuate together by {amount}")
        signal = each.level.signal
        # between the peaks of the comb, noise of the readout is not hidden by that of counting;
        # what was subtracted has moved the peaks
        is_readout_told = each.level.codes is not None and not each.unsure.is_any
        _note_line_noise(each, residuals, signal)
        if is_readout_told:
            apart = np.asarray(signal - np.rint(signal), np.float32)
            _note_line_noise(each, Residuals.of(apart, each.good), apart)
    return found


def _remove_drifts(found: Sequence[Steadied]) -> None:
    """Subtract linear drifts, and note them."""
    residuals = [each.residuals for each in found]
    drifts = [drift(each.mean) for each in residuals]
    if not any(abs(each.z) > _DRIFT_Z for each in drifts):
        return
    causes = [Varying.LIGHT, Varying.GAIN, Varying.DARK_COUNTS]
    if any(each.level.codes is not None for each in found):
        causes.append(Varying.OFFSET)
    reach = {
        cause: np.array(
            [
                of_level.reach(each.parts.shape_of(cause))
                for each, of_level in zip(found, residuals, strict=True)
            ]
        )
        for cause in causes
    }
    named = _drifting(drifts, reach, np.array([each.level.is_dark for each in found]))
    shape = named[0] if len(named) == 1 else Varying.GAIN
    name = {1: named[0].word, 2: "light or gain"}.get(len(named), "readings")
    for at, (each, one) in enumerate(zip(found, drifts, strict=True)):
        whole = 2 * one.change / max(reach[Varying.GAIN][at], 1e-12)
        is_seen = abs(one.z) > _DRIFT_Z and abs(whole) > _SMALLEST_DRIFT
        if not is_seen or reach[shape][at] <= 0:
            continue
        size, change = 2 * one.change / reach[shape][at], each.parts.shape_of(shape)
        ramp = np.linspace(-0.5, 0.5, len(each.level.readings))
        each.subtract(size * ramp[:, None, None] * change)
        # an offset is in counts; others are relative, and make it uncertain in proportion
        counts = abs(size) * float(change.mean())
        for cause in named:
            of_cause = counts if cause == Varying.OFFSET else abs(size)
            each.unsure = each.unsure.more(**{cause.parameter: of_cause})
        is_offset = named == (Varying.OFFSET,)
        amount = f"{size:+.2g} counts" if is_offset else f"{100 * size:+.2g} %"
        each.note(f"drift of {name}", f"{name} drifts by {amount}")


def _drifting(
    drifts: Sequence[Drift], reach: Mapping[Varying, Floats], is_dark: Mask
) -> tuple[Varying, ...]:
    """Quantity whose drift by one amount fits all levels clearly best, or those that may be it."""
    change, error = np.array([(each.change, max(each.error, 1e-12)) for each in drifts]).T
    moved = np.abs(change / error) > _DRIFT_Z
    gain = reach[Varying.GAIN]
    if not is_dark.any():
        return Varying.LIGHT, Varying.GAIN
    if not (moved & is_dark).any():
        seen = change[moved] / np.maximum(gain[moved], 1e-12)
        would = np.abs(seen).min() * gain[is_dark] / error[is_dark]
        return (Varying.LIGHT,) if (would > _DRIFT_Z).any() else (Varying.LIGHT, Varying.GAIN)
    misfit = {}
    for cause, reached in reach.items():
        use = reached / error
        size = float((use * change / error).sum() / max((use**2).sum(), 1e-300))
        # recordings may drift by different amounts: of those that a cause moves, a tenth is free
        slack = np.hypot(error, 0.1 * size * reached)
        misfit[cause] = float((((change - size * reached) / slack) ** 2).sum())
    best, second = sorted(misfit, key=lambda cause: misfit[cause])[:2]
    is_clear = misfit[second] - misfit[best] > _CLEARLY_BETTER
    fits = misfit[best] < 5 * len(drifts) + _CLEARLY_BETTER
    return (best,) if is_clear and fits else tuple(Varying)


def _remove_lines(found: Steadied) -> None:
    """Subtract flicker and banding, and note them."""
    moving, level = found.moving, found.level
    change, n = found.parts.shape_of(moving), len(level.readings)
    # lost frames count: they would break the phase of a line
    places = np.arange(n)
    if level.times_s is not None and n > 1:
        timed = np.rint((level.times_s - level.times_s[0]) / level.interval_s)
        if (np.diff(timed) > 0).all() and timed[-1] < _MOST_LOST * n:
            places = timed.astype(np.int64)
    for _ in range(_MOST_LINES):
        residuals = found.residuals
        line = _strongest(residuals, places)
        if line is None:
            return
        cycles, is_banding = line
        angle = 2 * np.pi * cycles * places
        waves = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        sums, pixels = residuals.z.sum(axis=2), residuals.varies.sum(axis=1)
        if not is_banding:
            sums, pixels = sums.sum(axis=1, keepdims=True), np.array([pixels.sum()])
        series = sums / np.maximum(pixels, 1)
        fitted = waves @ np.linalg.lstsq(waves, series, rcond=None)[0]
        fitted = fitted / max(residuals.reach(change), 1e-12)
        found.subtract(fitted[:, :, None] * change)
        size = float(np.sqrt(2 * np.square(fitted).mean()))
        _doubt(found, size / (np.pi * max(cycles * n, 1.0)), size * _mean_of(found))
        hertz = cycles / level.interval_s
        name = "row banding" if is_banding else "flicker"
        text = f"{name} of {hertz:.3g} Hz, ±{_amount(moving, size)}"
        found.note(name, text)


def _mean_of(found: Steadied) -> float:
    """Mean change of good pixels by what is moving."""
    return float(found.parts.shape_of(found.moving)[found.good].mean())


def _doubt(found: Steadied, size: float, counts: float) -> None:
    """Note what the removal of a fluctuation of this amplitude leaves uncertain."""
    parameters = {found.moving.parameter: size, "variance": _LEFT * counts**2 / 2}
    found.unsure = found.unsure.more(**parameters)


def _amount(moving: Varying, size: float) -> str:
    return f"{size:.2g} counts" if moving == Varying.OFFSET else f"{100 * size:.2g} %"


def _strongest(residuals: Residuals, places: Ints) -> tuple[float, bool] | None:
    """Cycles per frame of the strongest line of all pixels, or of rows (true), if no chance."""
    n, per_row = int(places[-1]) + 1, residuals.varies.sum(axis=1)
    used = per_row > 0
    bands = int(used.sum()) - 1
    if bands < 0 or len(residuals.z) < _FEWEST_FRAMES:
        return None
    rows = np.zeros((n, bands + 1), residuals.z.dtype)
    rows[places] = residuals.z.sum(axis=2)[:, used] / np.sqrt(per_row[used])
    weight = np.sqrt(per_row[used] / per_row.sum())
    spectra = np.fft.rfft(rows, axis=0)[_LOWEST_LINE : (n + 1) // 2]
    common = spectra @ weight
    power = np.square(np.abs(common)) / n
    apart = np.square(np.abs(spectra - common[:, None] * weight)).sum(axis=1) / n
    p_common, p_rows = _chance(power, 1), _chance(apart, bands)
    at = int(np.argmin(np.minimum(p_common, p_rows)))
    if min(p_common[at], p_rows[at]) * 2 * power.size > _CHANCE:
        return None
    if (np.minimum(p_common, p_rows) == 0).sum() > 1:
        at = int(np.argmax(power + apart))
    is_banding = bool(p_rows[at] * power.size < _CHANCE and apart[at] > _OF_ROWS * power[at])
    series = rows if is_banding else (rows @ weight)[:, None]
    cycles, width = float(at + _LOWEST_LINE), 1.0
    for _ in range(2):
        trials = (cycles + width * np.linspace(-1, 1, 61)) / n
        waves = np.exp(-2j * np.pi * trials[:, None] * np.arange(n))
        of_trials = np.square(np.abs(waves @ series)).sum(axis=1)
        cycles, width = float(trials[int(np.argmax(of_trials))]) * n, width / 20
    return cycles / n, is_banding


def _chance(power: Floats, series: int) -> Floats:
    """Chances of as much power of so many independent series, relative to the median."""
    if not series:
        return np.ones_like(power)
    scale = max(float(np.median(power)) / float(gamma.median(series)), 1e-300)
    return np.asarray(gamma.sf(power / scale, series))


def _note_line_noise(found: Steadied, residuals: Residuals, signal: NDArray[Any]) -> None:
    """Note noise that all pixels, or those of a row or column, share, once."""
    variance = np.asarray(signal, np.float32).var(axis=0)[found.good]
    common, error = residuals.far_correlation()
    for name in ("all", "row", "column"):
        share, of_line = (common, 0.0) if name == "all" else residuals.line_correlation(name)
        excess = share if name == "all" else share - max(common, 0.0)
        kind = "common noise" if name == "all" else f"{name} noise"
        is_new = kind not in {fault.kind for fault in found.faults}
        if is_new and excess > max(_NOISE_Z * np.hypot(of_line, error), _SMALLEST_SHARE):
            more = excess * float(variance.mean())
            found.unsure = found.unsure._replace(
                variance=found.unsure.variance + 2 * more, read_noise=2 * more
            )
            who = "all pixels" if name == "all" else f"pixels of each {name}"
            found.note(kind, f"{who} fluctuate together by {np.sqrt(more):.2g} counts")
