"""Steadiness in time: repeated and missing frames, drift, flicker, banding, common noise.

Readings of a pixel are standardized, z = (x − mean)/σ, so that no bright or noisy pixel dominates.
Without common fluctuations the mean of z over N pixels has the variance 1/N in every frame, and its
periodogram is exponential.

    repeated frames    frames equal to the one before, more than in the expected recording
    missing frames     gaps in the times of frames
    drift              second half against the first (`calibrate.steadiness`)
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
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.calibrate.steadiness import Drift, drift
from megalopta.sensor.compare.faults import Fault

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
_MAINS_HZ = (50.0, 60.0, 100.0, 120.0)


class Parts(NamedTuple):
    """Expected counts of one level, and how they follow light and dark counts (rows, columns)."""

    mean: Floats
    light: Floats
    """Derivative with respect to the logarithm of the light, in counts"""
    dark: Floats
    """Derivative with respect to the logarithm of dark counts"""

    def shape_of(self, cause: str) -> Floats:
        """Return the change of counts if a cause changes by its own size (an offset by 1)."""
        shapes: Mapping[str, Floats] = {
            "light": self.light,
            "gain": self.mean,
            "dark counts": self.dark,
            "offset": np.ones_like(self.dark),
        }
        return shapes[cause]


_PARAMETERS = {
    "light": ("efficiency",),
    "gain": ("step",),
    "dark counts": ("dark counts",),
    "offset": ("offset",),
    "light or gain": ("efficiency", "step"),
    "readings": ("efficiency", "step", "dark counts", "offset"),
}
"""Parameters of the device that a drift makes uncertain"""


@dataclass
class Steadied:
    """A level without its common fluctuations."""

    level: Level
    unsure: dict[str, float] = field(default_factory=dict)
    """Uncertainty of the device's parameters in this recording, and of "variance" (counts²)."""
    faults: list[Fault] = field(default_factory=list)


def without_repeats(captured: Level, expected: Level) -> tuple[Level, list[Fault]]:
    """Remove frames that repeat the one before, if these are more than expected."""
    same, chance = _repeats(captured), _repeats(expected).mean()
    # Laplace's rule: no repetition seen does not exclude one
    rate = (chance * len(expected.readings) + 1) / (len(expected.readings) + 2)
    z = (same.mean() - rate) / np.sqrt(rate * (1 - rate) / same.size)
    faults = []
    if z > norm.isf(_CHANCE) and same.sum() > 1:
        text = f"{same.sum()} of {same.size + 1} frames repeat the one before"
        faults.append(Fault("repeated frames", text))
        captured = captured.at(np.append(True, ~same))
    return captured, faults


def _repeats(level: Level) -> Mask:
    """Frames that repeat the one before, and are not all dark or all saturated."""
    frames = level.recorded.reshape(len(level.readings), -1)
    return np.array(
        [np.array_equal(one, other) and np.ptp(one) > 0 for one, other in pairwise(frames)]
    )


def dependent_frames(captured: Level, expected: Level, good: Mask) -> list[Fault]:
    """Return correlation with the frame before that most pixels share, beyond what is expected."""
    both = [_memory(each, good) for each in (captured, expected)]
    if min(each.size for each in both) < _FEWEST_PIXELS:
        return []
    share = float(np.median(both[0]) - np.median(both[1]))
    readings = len(captured.readings) * both[0].size, len(expected.readings) * both[1].size
    error = _OF_MEDIAN * np.sqrt(1 / readings[0] + 1 / readings[1])
    if abs(share) < max(_NOISE_Z * error, _SMALLEST_MEMORY):
        return []
    text = (
        f"readings of all pixels are correlated by {share:.2g} with those of the frame before, so "
        "that neither parameters nor pixels are tested"
    )
    return [Fault("dependent frames", text)]


def _memory(level: Level, good: Mask) -> Floats:
    """Correlation of pixels (P,) with the frame before, beside what the pixels of a row share."""
    z = _standardized(level, good)
    shared = z.mean(axis=2, keepdims=True)
    z = z - shared * (z * shared).sum(axis=0) / np.maximum(np.square(shared).sum(axis=0), 1e-30)
    power = np.square(z).sum(axis=0)
    tested = good & (power > 0) & (level.signal.sum(axis=0, dtype=np.float64) > _FEWEST_COUNTS)
    return np.asarray(((z[1:] * z[:-1]).sum(axis=0) / np.maximum(power, 1e-30))[tested])


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
    found = [Steadied(level) for level in levels]
    _remove_drifts(found, good, parts)
    for each, own, part in zip(found, good, parts, strict=True):
        _remove_lines(each, own, part)
        _remove_common_noise(each, own, part)
    return found


def _standardized(level: Level, good: Mask) -> Floats:
    """Readings of the good pixels less their mean, over their σ (n, rows, columns); others 0."""
    signal = np.asarray(level.signal, np.float32)
    spread = signal.std(axis=0)
    scale = np.where(good & (spread > 0), spread, np.inf)
    return np.asarray((signal - signal.mean(axis=0)) / scale)


def _sensitivity(level: Level, good: Mask, shape: Floats) -> float:
    """Change of the mean of z if counts change by this map."""
    spread = np.asarray(level.signal, np.float32).std(axis=0)
    counted = good & (spread > 0)
    return float((shape[counted] / spread[counted]).mean()) if counted.any() else 0.0


def _mean(z: Floats) -> Floats:
    """Mean of z over the pixels that vary, (n,)."""
    pixels = (z != 0).any(axis=0)
    return np.asarray(z.sum(axis=(1, 2)) / max(int(pixels.sum()), 1), np.float64)


def _remove_drifts(found: list[Steadied], good: Sequence[Mask], parts: Sequence[Parts]) -> None:
    levels = [each.level for each in found]
    drifts = [
        drift(_mean(_standardized(level, own))) for level, own in zip(levels, good, strict=True)
    ]
    if not any(abs(each.z) > _DRIFT_Z for each in drifts):
        return
    has_codes = any(level.codes is not None for level in levels)
    causes = ("light", "gain", "dark counts", *(("offset",) if has_codes else ()))
    reach = {
        cause: np.array(
            [
                _sensitivity(level, own, part.shape_of(cause))
                for level, own, part in zip(levels, good, parts, strict=True)
            ]
        )
        for cause in causes
    }
    name = _named(drifts, reach, np.array([level.is_dark for level in levels]))
    shape = name if name in causes else "gain"
    for at, (each, one) in enumerate(zip(found, drifts, strict=True)):
        whole = 2 * one.change / max(reach["gain"][at], 1e-12)
        is_seen = abs(one.z) > _DRIFT_Z and abs(whole) > _SMALLEST_DRIFT
        if is_seen and reach[shape][at] > 0:
            # of a linear drift, from beginning to end
            _remove_drift(each, name, 2 * one.change / reach[shape][at], parts[at].shape_of(shape))


def _remove_drift(found: Steadied, name: str, size: float, shape: Floats) -> None:
    """Subtract a linear drift of this size, and note it."""
    ramp = np.linspace(-0.5, 0.5, len(found.level.readings))
    found.level = _less(found.level, size * ramp[:, None, None] * shape)
    # an offset is in counts; other drifts are relative, and make an offset uncertain in proportion
    counts = abs(size) * float(shape.mean())
    for parameter in _PARAMETERS[name]:
        found.unsure[parameter] = counts if parameter == "offset" else abs(size)
    amount = f"{size:+.2g} counts" if name == "offset" else f"{100 * size:+.2g} %"
    found.faults.append(Fault(f"drift of {name}", f"{name} drifts by {amount}"))


def _named(drifts: Sequence[Drift], reach: Mapping[str, Floats], is_dark: Mask) -> str:
    """Name the quantity whose drift by one amount fits all levels clearly best."""
    change, error = np.array([(each.change, max(each.error, 1e-12)) for each in drifts]).T
    moved = np.abs(change / error) > _DRIFT_Z
    misfit = {}
    for cause, reached in reach.items():
        use = reached / error
        size = float((use * change / error).sum() / max((use**2).sum(), 1e-300))
        # recordings may drift by different amounts: of those that a cause moves, a tenth is free
        slack = np.hypot(error, 0.1 * size * reached)
        misfit[cause] = float((((change - size * reached) / slack) ** 2).sum())
    if not (moved & is_dark).any() and is_dark.any():
        seen = change[moved] / np.maximum(reach["gain"][moved], 1e-12)
        would = np.abs(seen).min() * reach["gain"][is_dark] / error[is_dark]
        return "light" if (would > _DRIFT_Z).any() else "light or gain"
    if not is_dark.any():
        return "light or gain"
    best, second = sorted(misfit, key=lambda each: misfit[each])[:2]
    is_clear = misfit[second] - misfit[best] > _CLEARLY_BETTER
    fits = misfit[best] < 5 * len(drifts) + _CLEARLY_BETTER
    return best if is_clear and fits else "readings"


def _less(level: Level, change: Floats) -> Level:
    """Subtract a change from the signal of a level."""
    left = np.asarray(level.signal - change, np.float32)
    if level.unrounded is None:
        return replace(level, readings=left)
    moved = np.rint(left.clip(0)) - np.rint(np.asarray(level.unrounded).clip(0))
    return replace(level, unrounded=left, readings=np.maximum(level.readings + moved, 0))


class _Line(NamedTuple):
    """Line of a periodogram."""

    cycles: float
    """Cycles per frame"""
    is_banding: bool


def _remove_lines(found: Steadied, good: Mask, part: Parts) -> None:
    shape, parameter = _moving(found.level, part)
    places = _places(found.level)
    for _ in range(_MOST_LINES):
        z = _standardized(found.level, good)
        line = _strongest(z, places)
        if line is None:
            return
        fitted = _fitted_line(z, line, places) / max(_sensitivity(found.level, good, shape), 1e-12)
        found.level = _less(found.level, fitted[:, :, None] * shape)
        size = float(np.sqrt(2 * np.square(fitted).mean()))
        turns = max(line.cycles * len(z), 1.0)
        _doubt(found, parameter, size / (np.pi * turns), size * float(shape[good].mean()))
        hertz = line.cycles / found.level.interval_s
        name = "row banding" if line.is_banding else "flicker"
        unit = f"{size:.2g} counts" if parameter == "offset" else f"{100 * size:.2g} %"
        text = f"{name} of {hertz:.3g} Hz{_alias(hertz, found.level, len(z))}, ±{unit}"
        found.faults.append(Fault(name, text))


def _places(level: Level) -> Ints:
    """Number of each frame (n,), lost ones counted: they would break the phase of a line."""
    places = np.arange(len(level.readings))
    if level.times_s is None or len(places) < 2:
        return places
    timed = np.rint((level.times_s - level.times_s[0]) / level.interval_s)
    is_usable = (np.diff(timed) > 0).all() and timed[-1] < _MOST_LOST * len(places)
    return timed.astype(np.int64) if is_usable else places


def _moving(level: Level, part: Parts) -> tuple[Floats, str]:
    """Map that a common fluctuation moves most probably, light or the output; its parameter."""
    if not level.is_dark:
        return part.light, "efficiency"
    if level.codes is not None:
        return np.ones_like(part.mean), "offset"
    return part.mean, "step"


def _doubt(found: Steadied, parameter: str, size: float, counts: float) -> None:
    """Note what the removal of a fluctuation of this amplitude leaves uncertain."""
    for name, more in ((parameter, size), ("variance", _LEFT * counts**2 / 2)):
        found.unsure[name] = float(np.hypot(found.unsure.get(name, 0.0), more))


def _strongest(z: Floats, places: Ints) -> _Line | None:
    """Strongest line of all pixels or of rows, if it is no chance."""
    n, per_row = int(places[-1]) + 1, (z != 0).any(axis=0).sum(axis=1)
    own = per_row > 0
    bands = int(own.sum()) - 1
    if bands < 0 or len(z) < _FEWEST_FRAMES:
        return None
    rows = np.zeros((n, bands + 1), z.dtype)
    rows[places] = z.sum(axis=2)[:, own] / np.sqrt(per_row[own])
    weight = np.sqrt(per_row[own] / per_row.sum())
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
    return _Line(_refined(series, at + _LOWEST_LINE), is_banding)


def _chance(power: Floats, series: int) -> Floats:
    """Chances of as much power of so many independent series, relative to the median."""
    if not series:
        return np.ones_like(power)
    scale = max(float(np.median(power)) / float(gamma.median(series)), 1e-300)
    return np.asarray(gamma.sf(power / scale, series))


def _refined(series: Floats, place: int) -> float:
    """Frequency of a line near a bin, in cycles per frame."""
    n, cycles, width = len(series), float(place), 1.0
    for _ in range(2):
        trials = (cycles + width * np.linspace(-1, 1, 61)) / n
        waves = np.exp(-2j * np.pi * trials[:, None] * np.arange(n))
        power = np.square(np.abs(waves @ series)).sum(axis=1)
        cycles, width = float(trials[int(np.argmax(power))]) * n, width / 20
    return cycles / n


def _fitted_line(z: Floats, line: _Line, places: Ints) -> Floats:
    """Line in the means of z over all pixels (n, 1), or over rows (n, rows)."""
    angle = 2 * np.pi * line.cycles * places
    waves = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    varies = (z != 0).any(axis=0)
    sums = z.sum(axis=2) if line.is_banding else z.sum(axis=(1, 2))[:, None]
    pixels = varies.sum(axis=1) if line.is_banding else np.array([varies.sum()])
    series = sums / np.maximum(pixels, 1)
    return np.asarray(waves @ np.linalg.lstsq(waves, series, rcond=None)[0])


def _alias(hertz: float, level: Level, frames: int) -> str:
    """Name the mains frequency that appears at this one at the rate of the frames."""
    rate, width = 1 / level.interval_s, 1 / (frames * level.interval_s)
    for mains in _MAINS_HZ:
        if abs(mains - hertz) < width:
            return ""
        if mains > rate / 2 and abs(abs(mains - rate * np.rint(mains / rate)) - hertz) < width / 2:
            return f" (as {mains:g} Hz appears at {rate:.4g} frames/s)"
    return ""


def _remove_common_noise(found: Steadied, good: Mask, part: Parts) -> None:
    """Remove noise that all pixels share, and note that of rows and columns."""
    shape, parameter = _moving(found.level, part)
    z = _standardized(found.level, good)
    total, total_error = _far_correlation(z.sum(axis=2), (z != 0).any(axis=0).sum(axis=1))
    if total > _NOISE_Z * total_error and total > _SMALLEST_SHARE:
        reach = max(_sensitivity(found.level, good, shape), 1e-12)
        size = float(np.sqrt(total)) / reach
        found.level = _less(found.level, (_mean(z) / reach)[:, None, None] * shape)
        _doubt(found, parameter, size / np.sqrt(len(z)), 2 * size * float(shape[good].mean()))
        unit = f"{size:.2g} counts" if parameter == "offset" else f"{100 * size:.2g} %"
        found.faults.append(Fault("common noise", f"all pixels fluctuate together by {unit}"))
    # between the peaks of the comb, noise of the readout is not hidden by that of counting; what
    # was subtracted has moved the peaks
    of_readout = [] if found.unsure else _residuals(found.level, good)
    for each, scale in ((z, _mean_variance(found.level.signal, good)), *of_readout):
        _note_line_noise(found, each, scale)


def _residuals(level: Level, good: Mask) -> list[tuple[Floats, float]]:
    """Standardized distances of readings from the nearest peak, and their variance."""
    if level.codes is None:
        return []
    apart = np.asarray(level.signal - np.rint(level.signal), np.float32)
    return [(_standardized(replace(level, unrounded=apart), good), _mean_variance(apart, good))]


def _mean_variance(signal: NDArray[Any], good: Mask) -> float:
    return float(np.asarray(signal, np.float32).var(axis=0)[good].mean()) if good.any() else 0.0


def _note_line_noise(found: Steadied, z: Floats, variance: float) -> None:
    """Note noise that pixels of a row or column share, once."""
    common, error = _far_correlation(z.sum(axis=2), (z != 0).any(axis=0).sum(axis=1))
    for name, turned in (("all", z), ("row", z), ("column", z.swapaxes(1, 2))):
        share, own_error = (common, 0.0) if name == "all" else _line_correlation(turned)
        excess = share if name == "all" else share - max(common, 0.0)
        kind = "common noise" if name == "all" else f"{name} noise"
        is_new = kind not in {each.kind for each in found.faults}
        if is_new and excess > max(_NOISE_Z * np.hypot(own_error, error), _SMALLEST_SHARE):
            more = excess * variance
            found.unsure["variance"] = found.unsure.get("variance", 0.0) + 2 * more
            found.unsure["read noise"] = 2 * more
            who = "all pixels" if name == "all" else f"pixels of each {name}"
            text = f"{who} fluctuate together by {np.sqrt(more):.2g} counts"
            found.faults.append(Fault(kind, text))


def _far_correlation(sums: Floats, pixels: Floats) -> tuple[float, float]:
    """Mean correlation of pixels at least four rows apart, and its standard error."""
    products, pairs = np.zeros(len(sums)), 0.0
    for row in range(sums.shape[1] - _FAR):
        products += sums[:, row] * sums[:, row + _FAR :].sum(axis=1)
        pairs += float(pixels[row] * pixels[row + _FAR :].sum())
    return _mean_and_error(products / pairs) if pairs else (0.0, np.inf)


def _line_correlation(z: Floats) -> tuple[float, float]:
    """Mean correlation of pixels of one row, four or more columns apart."""
    varies = (z != 0).any(axis=0).astype(float)
    later = np.cumsum(z[:, :, ::-1], axis=2)[:, :, ::-1]
    number = np.cumsum(varies[:, ::-1], axis=1)[:, ::-1]
    if z.shape[2] <= _FAR:
        return 0.0, np.inf
    products = (z[:, :, :-_FAR] * later[:, :, _FAR:]).sum(axis=(1, 2))
    pairs = float((varies[:, :-_FAR] * number[:, _FAR:]).sum())
    return _mean_and_error(products / pairs) if pairs else (0.0, np.inf)


def _mean_and_error(values: Floats) -> tuple[float, float]:
    return float(values.mean()), float(values.std(ddof=1) / np.sqrt(len(values)))
