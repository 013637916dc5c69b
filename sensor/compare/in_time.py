"""Steadiness in time: repeated and missing frames, drift, flicker, banding, common noise.

Without common fluctuations the mean over N pixels of standardized readings z (`residual`) has the
variance 1/N in every frame, and its periodogram is exponential.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.stats import gamma, norm

from megalopta.core.arrays import Floats, Ints
from megalopta.sensor.calibrate.level import Drift, drift
from megalopta.sensor.compare.residual import Residual, Standardized

_CHANCE = 1e-6
"""Chance of a false line, or repetition, in one recording."""
_DRIFT_Z = 5.0
_SMALLEST_DRIFT = 0.01
_CLEARLY_BETTER = 16.0
_DRIFTING = {
    "efficiency": "light",
    "step": "gain",
    "dark counts": "dark counts",
    "offset": "offset",
}
"""What drifts, by the parameter of the device that changes as it does"""
_FEWEST_FRAMES, _FEWEST_PIXELS = 16, 16
_LOWEST_LINE = 3
"""Cycles per recording below which a line is a drift."""
_NOISE_Z = 6.0
_SMALLEST_SHARE = 5e-4
"""Share of the variance of a pixel below which common noise is negligible."""


def check_frames(level: Residual) -> None:
    """Note missing frames, and remove those that repeat the one before, if more than expected."""
    captured, expected = level.captured, level.expected
    same, usual = (
        np.array(
            [
                # not all dark or all saturated
                np.array_equal(before, frame) and np.ptp(before) > 0
                for before, frame in pairwise(frames.recorded.reshape(len(frames.readings), -1))
            ]
        )
        for frames in (captured, expected)
    )
    # Laplace's rule: no repetition seen does not exclude one
    rate = (usual.mean() * len(expected.readings) + 1) / (len(expected.readings) + 2)
    z = (same.mean() - rate) / np.sqrt(rate * (1 - rate) / same.size)
    if z > norm.isf(_CHANCE) and same.sum() > 1:
        text = f"{same.sum()} of {same.size + 1} frames repeat the one before"
        level.note("repeated frames", text)
        level.captured = captured.at(np.append(True, ~same))
    if captured.times_s is None or len(captured.times_s) < 3:
        return
    missing = np.rint(np.diff(captured.times_s) / captured.interval_s) - 1
    places = int((missing > 0).sum())
    if places:
        where = "in one place" if places == 1 else f"in {places} places"
        text = f"{missing[missing > 0].sum():.0f} frames are missing {where}"
        level.note("missing frames", text)


def check_dependence(level: Residual) -> bool:
    """Note correlation with the frame before that most pixels share, beyond what is expected."""
    memories, readings, good = [], [], level.good
    for frames in (level.captured, level.expected):
        # beside what the pixels of a row share
        z = Standardized.of(frames.signal, good).z
        shared = z.mean(axis=2, keepdims=True)
        z = z - shared * (z * shared).sum(axis=0) / np.maximum(np.square(shared).sum(axis=0), 1e-30)
        power = np.square(z).sum(axis=0)
        counts = frames.signal.sum(axis=0, dtype=np.float64)
        tested = good & (power > 0) & (counts > 30.0)
        memories.append(((z[1:] * z[:-1]).sum(axis=0) / np.maximum(power, 1e-30))[tested])
        readings.append(len(frames.readings) * memories[-1].size)
    if min(memory.size for memory in memories) < _FEWEST_PIXELS:
        return False
    share = float(np.median(memories[0]) - np.median(memories[1]))
    # of a median, 1.2533 times that of a mean
    error = 1.2533 * np.sqrt(1 / readings[0] + 1 / readings[1])
    if abs(share) < max(_NOISE_Z * error, 0.01):
        return False
    text = (
        f"readings of all pixels are correlated by {share:.2g} with those of the frame before, so "
        "that neither parameters nor pixels are tested"
    )
    level.note("dependent frames", text)
    return True


def steady(levels: Sequence[Residual]) -> None:
    """Remove and note the common fluctuations of levels."""
    _remove_drifts(levels)
    for level in levels:
        _remove_lines(level)
        standardized, change = level.standardized, level.parts[level.moving]
        correlation, error = standardized.far_correlation()
        if correlation > _NOISE_Z * error and correlation > _SMALLEST_SHARE:
            reach = max(standardized.reach(change), 1e-12)
            size = float(np.sqrt(correlation)) / reach
            level.subtract((standardized.mean / reach)[:, None, None] * change)
            _doubt_rest(level, size / np.sqrt(len(standardized.z)), 2 * size)
            amount = _amount(level.moving, size)
            level.note("common noise", f"all pixels fluctuate together by {amount}")
        signal = level.captured.signal
        # between the peaks of the comb, noise of the readout is not hidden by that of counting;
        # what was subtracted has moved the peaks
        is_readout_seen = level.captured.codes is not None and not level.uncertainty
        _note_line_noise(level, standardized, signal)
        if is_readout_seen:
            signal = np.asarray(signal - np.rint(signal), np.float32)
            _note_line_noise(level, Standardized.of(signal, level.good), signal)


def _remove_drifts(levels: Sequence[Residual]) -> None:
    standardized = [level.standardized for level in levels]
    drifts = [drift(readings.mean) for readings in standardized]
    if not any(abs(change.z) > _DRIFT_Z for change in drifts):
        return
    pairs = list(zip(levels, standardized, strict=True))
    reach = {
        parameter: np.array([readings.reach(level.parts[parameter]) for level, readings in pairs])
        for parameter in _DRIFTING
    }
    causes = _drifting(levels, drifts, reach)
    shape = causes[0] if len(causes) == 1 else "step"
    name = {1: _DRIFTING[causes[0]], 2: "light or gain"}.get(len(causes), "readings")
    for at, (level, change) in enumerate(zip(levels, drifts, strict=True)):
        relative = 2 * change.change / max(reach["step"][at], 1e-12)
        is_seen = abs(change.z) > _DRIFT_Z and abs(relative) > _SMALLEST_DRIFT
        if not is_seen or reach[shape][at] <= 0:
            continue
        size, counts = 2 * change.change / reach[shape][at], level.parts[shape]
        ramp = np.linspace(-0.5, 0.5, len(level.captured.readings))
        level.subtract(size * ramp[:, None, None] * counts)
        for cause in causes:
            in_counts = abs(size) * float(counts.mean())
            level.doubt(cause, in_counts if cause == "offset" else abs(size))
        amount = f"{size:+.2g} counts" if causes == ("offset",) else f"{100 * size:+.2g} %"
        level.note(f"drift of {name}", f"{name} drifts by {amount}")


def _drifting(
    levels: Sequence[Residual], drifts: Sequence[Drift], reach: dict[str, Floats]
) -> tuple[str, ...]:
    """Parameter whose drift by one amount fits all levels clearly best, or those that may be it."""
    is_dark = np.array([level.captured.is_dark for level in levels])
    change, error = np.array([(drift.change, max(drift.error, 1e-12)) for drift in drifts]).T
    moved = np.abs(change / error) > _DRIFT_Z
    if not (moved & is_dark).any():
        # darkness would show as large a drift of the gain
        seen = change[moved] / np.maximum(reach["step"][moved], 1e-12)
        would = np.abs(seen).min() * reach["step"][is_dark] / error[is_dark]
        return ("efficiency",) if (would > _DRIFT_Z).any() else ("efficiency", "step")
    misfit = {}
    for parameter, reached in reach.items():
        use = reached / error
        size = float((use * change / error).sum() / max((use**2).sum(), 1e-300))
        # recordings may drift by different amounts: of those that a cause moves, a tenth is free
        slack = np.hypot(error, 0.1 * size * reached)
        misfit[parameter] = float((((change - size * reached) / slack) ** 2).sum())
    if all(level.captured.codes is None for level in levels):
        del misfit["offset"]
    best, second = sorted(misfit, key=lambda parameter: misfit[parameter])[:2]
    is_clear = misfit[second] - misfit[best] > _CLEARLY_BETTER
    fits = misfit[best] < 5 * len(drifts) + _CLEARLY_BETTER
    return (best,) if is_clear and fits else tuple(_DRIFTING)


def _remove_lines(level: Residual) -> None:
    moving, captured = level.moving, level.captured
    change, n = level.parts[moving], len(captured.readings)
    # lost frames count: they would break the phase of a line
    places = np.arange(n)
    if captured.times_s is not None and n > 1:
        timed = np.rint((captured.times_s - captured.times_s[0]) / captured.interval_s)
        if (np.diff(timed) > 0).all() and timed[-1] < 4 * n:  # not if most are lost
            places = timed.astype(np.int64)
    for _ in range(3):
        standardized = level.standardized
        line = _strongest(standardized, places)
        if line is None:
            return
        cycles, is_banding = line
        angle = 2 * np.pi * cycles * places
        waves = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        sums, pixels = standardized.z.sum(axis=2), standardized.varies.sum(axis=1)
        if not is_banding:
            sums, pixels = sums.sum(axis=1, keepdims=True), np.array([pixels.sum()])
        series = sums / np.maximum(pixels, 1)
        fitted = waves @ np.linalg.lstsq(waves, series, rcond=None)[0]
        fitted = fitted / max(standardized.reach(change), 1e-12)
        level.subtract(fitted[:, :, None] * change)
        size = float(np.sqrt(2 * np.square(fitted).mean()))
        _doubt_rest(level, size / (np.pi * max(cycles * n, 1.0)), size)
        name = "row banding" if is_banding else "flicker"
        text = f"{name} of {cycles / captured.interval_s:.3g} Hz, ±{_amount(moving, size)}"
        level.note(name, text)


def _doubt_rest(level: Residual, left: float, removed: float) -> None:
    """Note what the removal of a fluctuation of an amplitude leaves uncertain."""
    counts = removed * float(level.parts[level.moving][level.good].mean())
    level.doubt(level.moving, left)
    level.doubt("variance", 0.2 * counts**2 / 2)


def _amount(moving: str, size: float) -> str:
    return f"{size:.2g} counts" if moving == "offset" else f"{100 * size:.2g} %"


def _strongest(standardized: Standardized, places: Ints) -> tuple[float, bool] | None:
    """Cycles per frame of the strongest line of all pixels, or of rows (true), if no chance."""
    n, per_row = int(places[-1]) + 1, standardized.varies.sum(axis=1)
    used = per_row > 0
    bands = int(used.sum()) - 1
    if bands < 0 or len(standardized.z) < _FEWEST_FRAMES:
        return None
    rows = np.zeros((n, bands + 1), standardized.z.dtype)
    rows[places] = standardized.z.sum(axis=2)[:, used] / np.sqrt(per_row[used])
    weight = np.sqrt(per_row[used] / per_row.sum())
    spectra = np.fft.rfft(rows, axis=0)[_LOWEST_LINE : (n + 1) // 2]
    common = spectra @ weight
    power = np.square(np.abs(common)) / n
    of_rows = np.square(np.abs(spectra - common[:, None] * weight)).sum(axis=1) / n
    p_common, p_rows = _chance(power, 1), _chance(of_rows, bands)
    at = int(np.argmin(np.minimum(p_common, p_rows)))
    if min(p_common[at], p_rows[at]) * 2 * power.size > _CHANCE:
        return None
    if (np.minimum(p_common, p_rows) == 0).sum() > 1:
        at = int(np.argmax(power + of_rows))
    is_banding = bool(p_rows[at] * power.size < _CHANCE and of_rows[at] > 0.2 * power[at])
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


def _note_line_noise(level: Residual, standardized: Standardized, signal: Floats) -> None:
    """Note noise that all pixels, or those of a row or column, share, once."""
    variance = np.asarray(signal, np.float32).var(axis=0)[level.good]
    common, error = standardized.far_correlation()
    lines = {}
    for name in ("row", "column"):
        share, of_line = standardized.line_correlation(name)
        lines[name] = share - max(common, 0.0), np.hypot(of_line, error)
    for kind, pixels, (excess, sigma) in (
        ("common noise", "all pixels", (common, error)),
        ("row noise", "pixels of each row", lines["row"]),
        ("column noise", "pixels of each column", lines["column"]),
    ):
        is_new = kind not in {fault.kind for fault in level.faults}
        if is_new and excess > max(_NOISE_Z * sigma, _SMALLEST_SHARE):
            noise = excess * float(variance.mean())
            level.uncertainty["variance"] = level.uncertainty.get("variance", 0.0) + 2 * noise
            level.uncertainty["read noise"] = 2 * noise
            level.note(kind, f"{pixels} fluctuate together by {np.sqrt(noise):.2g} counts")
