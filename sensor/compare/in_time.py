"""Faults in time: lost and odd frames, lag, drifts, steps, flicker, banding, noise that is shared.

Of independent frames, the mean over N pixels of standardized readings z (`residual`) has the
variance 1/N in every frame, and its periodogram is exponential. A change in time is fitted to the
frames of even number, and is one only if it predicts those of odd number.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import gamma, norm

from megalopta.core.arrays import Floats, Ints, Mask, robust_sigma
from megalopta.sensor.compare.residual import Residual, Standardized

_CHANCE = 1e-6
"""Chance of a false line, or repetition, in one recording."""
_FEWEST_FRAMES, _FEWEST_PIXELS = 16, 16
_QUANTITIES = {
    "efficiency": "light",
    "step": "gain",
    "dark counts": "dark counts",
    "offset": "offset",
    "light leak": "",
}
"""What changes in time, by the parameter of the device that acts like it; a leak is not stated"""
_REAL_GAIN, _CLEARLY_BETTER = 25.0, 16.0
"""Gain of χ² of a change that is no chance, and of a quantity over the next"""
_LOWEST_LINE = 3
"""Cycles per recording below which a line is a drift."""
_NOISE_Z = 6.0
_SMALLEST_SHARE = 5e-4
"""Share of the variance of a pixel below which common noise is negligible."""
_LAGS = 6
FIRST = "the first frames are off as a whole"
_SURE = -35.0
"""Logarithm of the chance that a part of a frame is as it is."""


def check_frames(level: Residual) -> None:
    """Note missing frames, and remove those that repeat the one before, if more than expected."""
    captured, expected = level.captured, level.expected
    if captured.times_s is not None and len(captured.times_s) > 2:
        missing = np.rint(np.diff(captured.times_s) / captured.interval_s) - 1
        if places := int((missing > 0).sum()):
            where = "in one place" if places == 1 else f"in {places} places"
            text = f"{missing[missing > 0].sum():.0f} frames are missing {where}"
            level.note("missing frames", text)
    # pixels that never change, dead or saturated, show no repetition
    changing = np.ptp(captured.recorded, axis=0) > 0
    if not changing.any():
        return
    same, usual = (
        np.array([np.array_equal(*pair) for pair in pairwise(frames.recorded[:, changing])])
        for frames in (captured, expected)
    )
    # Laplace's rule: no repetition seen does not exclude one
    rate = (usual.mean() * len(expected.readings) + 1) / (len(expected.readings) + 2)
    z = (same.mean() - rate) / np.sqrt(rate * (1 - rate) / same.size)
    if z > norm.isf(_CHANCE) and same.sum() > 1 and usual.mean() < 0.1:
        text = f"{same.sum()} of {same.size + 1} frames repeat the one before"
        level.note("repeated frames", text)
        level.keep(np.append(True, ~same))


def check_parts(level: Residual) -> None:
    """Note parts of frames that are empty, full or old, and remove these frames.

    A part is lost if all its pixels read alike, of which the chance is exp(`_SURE`).
    """
    frames, expected = level.captured.recorded, len(level.expected.readings)
    n, rows, columns = frames.shape
    tiles = {(1, columns), (rows, 1), (1, min(8, columns)), (min(8, rows), 1), (4, 4)}
    lost = np.zeros(frames.shape, np.bool_)
    for equal, usual_share in _alike(frames, level.expected.recorded):
        log = np.log((usual_share * expected + 1) / (expected + 2))
        # pixels that are always so are dead or stuck
        equal &= equal.mean(axis=0) < 0.9
        for down, right in tiles:
            tall, wide = rows // down * down, columns // right * right
            whole = n, tall // down, down, wide // right, right
            share = equal[:, :tall, :wide].reshape(whole).mean(axis=(2, 4))
            is_no_chance = log[:tall, :wide].reshape(whole[1:]).sum(axis=(1, 3)) < _SURE
            is_whole = (share == 1) & is_no_chance
            # parts that noise makes dark, or bright, are seldom so to the last pixel
            if is_whole.sum() > ((share >= 0.8) & (share < 1) & is_no_chance).sum():
                lost[:, :tall, :wide] |= is_whole.repeat(down, axis=1).repeat(right, axis=2)
    # a frame of which nearly nothing is left is odd as a whole
    lost &= (lost.mean(axis=(1, 2)) < 0.9)[:, None, None]
    places = np.asarray(lost.any(axis=(1, 2)))
    if not places.any():
        return
    text = f"parts of {places.sum()} of {n} frames are empty, full or old"
    level.note("lost parts", f"{text}, {100 * lost.mean():.2g} % of all readings")
    if places.mean() < 0.6:
        level.keep(~places)
    else:
        level.masked = level.masked | lost.any(axis=0)


def _alike(frames: NDArray[Any], usual: NDArray[Any]) -> Iterator[tuple[Mask, Floats]]:
    """Yield readings at an end of the range, or as in the frame before, and their usual share."""
    for end in np.unique([0, frames.min(), frames.max(), usual.max()]):
        yield frames == end, (usual == end).mean(axis=0)
    first = np.zeros((1, *frames.shape[1:]), np.bool_)
    yield np.concatenate((first, frames[1:] == frames[:-1])), (usual[1:] == usual[:-1]).mean(axis=0)


def check_odd_frames(level: Residual) -> None:
    """Remove and note frames that are off, by 5 σ and beyond expected ones, or once in a cycle."""
    shown, known = level.standardized, Standardized.of(level.expected.signal, level.good)
    n = len(shown.z)
    if shown.varies.sum() < _FEWEST_PIXELS or n < _FEWEST_FRAMES:
        return
    off = np.zeros(n, np.bool_)
    for seen, usual in zip(_mean_and_spread(shown), _mean_and_spread(known), strict=True):
        middle = np.median(seen)
        sigma = max(robust_sigma(seen - middle), float(usual.std()), 1e-12)
        far = np.abs(seen - middle) / sigma
        # a long tail is noise, not odd frames
        if (far > 7.0).sum() > 2 * ((far > 3.5) & (far <= 7.0)).sum():
            off |= far > max(5.0, float(np.abs(usual - usual.mean()).max() / sigma) * 1.2)
    if off.mean() < 0.02:
        cycle = _odd_of_cycle(shown, level.numbers)
        off = off if cycle is None else cycle
    runs = 1 + int((np.diff(np.flatnonzero(off)) > 1).sum())
    # a change that lasts to the end, or from the start, is a step
    lasts = runs == 1 and off.sum() > 3 and (off[0] or off[-1])
    if not off.any() or off.mean() > 0.55 or lasts:
        return
    # those that are off in few rows or columns are not off as a whole
    excess = np.where(shown.varies, np.square(shown.z[off].mean(axis=0)) - 1 / off.sum(), 0)
    lines = excess.sum(axis=0), excess.sum(axis=1)
    if any(np.median(line) <= 0.1 * line.max() for line in lines):
        level.note("none", "parts of some frames are off")
    elif off[0] and not off[_LAGS:].any():
        level.note("odd frames", FIRST)
    else:
        steps = np.diff(level.numbers[off])
        is_regular = off.sum() > 3 and (steps == steps[0]).mean() > 0.9 and steps[0] > 1
        every = f", one in {steps[0]}" if is_regular else ""
        level.note("odd frames", f"{off.sum()} of {n} frames are off as a whole{every}")
    level.keep(~off)


def _mean_and_spread(shown: Standardized) -> tuple[Floats, Floats]:
    """Mean and variance over the pixels of z of each frame, (n,) each."""
    square = np.minimum(np.square(shown.z), 50.0).sum(axis=(1, 2), dtype=np.float64)
    return shown.mean, square / max(int(shown.varies.sum()), 1) - shown.mean**2


def _odd_of_cycle(shown: Standardized, numbers: Ints) -> Mask | None:
    """Frames of the one phase of a cycle of 2 to 12 frames that is off, if one is."""
    series, odd, gain = shown.mean, None, 0.0
    for length in range(2, 13):
        phase = numbers % length
        frames = np.bincount(phase, minlength=length)
        if frames.min() < 3:
            continue
        means = np.bincount(phase, series, length) / frames
        at = int(np.argmax(np.abs(means - np.median(means))))
        rest, many = np.delete(means, at), int(frames[at])
        of_cycle = many * (1 - many / len(series)) * float(means[at] - rest.mean()) ** 2
        if of_cycle > gain and many * np.square(rest - rest.mean()).sum() < 0.1 * of_cycle:
            odd, gain = phase == at, of_cycle
    left = max(float(series.var()) - gain / len(series), 1 / float(shown.varies.sum()))
    return odd if gain / left > 60.0 else None


def check_lag(level: Residual) -> bool:
    """Note lag, frames that contain a part of former ones: 6 σ in all pixels, or 7 σ in lines."""
    signal, usual = level.captured.signal, level.expected.signal
    near, slow, tested = _memory(level, signal, np.diff(level.numbers) == 1)
    usual_near, usual_slow, is_known = _memory(level, usual, np.ones(len(usual) - 1) > 0)
    tested &= is_known
    if tested.sum() < _FEWEST_PIXELS:
        return False
    change = near - usual_near
    # of a median, 1.2533 times that of a mean
    error = 1.2533 * (1.25 / len(signal) + 1.25 / len(usual)) ** 0.5
    share, where = float(np.median(change[tested])), "all pixels"
    if abs(share) > max(_NOISE_Z * error / np.sqrt(tested.sum()), 0.004):
        if share < 0.5 * float(np.median((slow - usual_slow)[tested])):
            level.note("none", "pixels change slowly, each in its way")
            return False
    else:
        for name, axis in (("row", 1), ("column", 0)):
            number = tested.sum(axis=axis)
            # pixels that are not tested come last
            ranked = np.sort(np.where(tested, change, np.inf), axis=axis)
            middle = np.expand_dims((number.clip(1) - 1) // 2, axis)
            medians = np.take_along_axis(ranked, middle, axis).squeeze(axis)
            far = np.abs(medians) > np.maximum(7 * error / np.sqrt(number.clip(1)), 0.02)
            if lines := np.flatnonzero(far & (number > 3)).tolist():
                where = f"{name}s {', '.join(map(str, lines[:8]))}"
                share = float(change.take(lines, axis=1 - axis).mean())
                break
        else:
            return False
    text = f"readings of {where} are correlated by {share:.2g} with"
    if share > 0:
        level.note("lag", f"{text} those of the frame before, so that parameters are not tested")
    else:
        level.note("none", f"{text} the frame before")
    level.inflation = 1 + 2 * _LAGS * min(abs(share), 0.5)
    return True


def _memory(level: Residual, signal: NDArray[Any], is_next: Mask) -> tuple[Floats, Floats, Mask]:
    """Correlations of pixels with their next reading and with later ones, and where they are known.

    (rows, columns) each, beside what the pixels of a row share, and of the next reading beyond
    those later; `is_next`, (n − 1,): no frame is lost between.
    """
    z = Standardized.of(signal, level.good).z
    shared = z.mean(axis=2, keepdims=True)
    z = z - shared * (z * shared).sum(axis=0) / np.maximum(np.square(shared).sum(axis=0), 1e-30)
    power = np.square(z).sum(axis=0)
    near = (z[1:] * z[:-1])[is_next].sum(axis=0) * is_next.size / max(is_next.sum(), 1)
    # slow changes correlate frames far apart as much
    far = np.mean([(z[lag:] * z[:-lag]).sum(axis=0) for lag in (9, 11, 13, 16)], axis=0)
    tested = level.good & (power > 0) & (signal.sum(axis=0, dtype=np.float64) > 30.0)
    power = np.maximum(power, 1e-30)
    return (near - far) / power, far / power, tested


class _Course(NamedTuple):
    """Course in time of what all pixels of a level share."""

    kind: str
    """"drift of", "step of" or ""."""
    values: Floats
    """(n,) of mean 0 and span 1"""
    gain: float
    """Gain of χ² of frames that were not fitted"""


def _course(level: Residual) -> _Course:
    """Return the drift or step that predicts the frames of odd number best."""
    standardized = level.standardized
    series, n, numbers = standardized.mean, len(level.captured.readings), level.numbers
    if n < 2 * _FEWEST_FRAMES or standardized.varies.sum() < _FEWEST_PIXELS:
        return _Course("", np.zeros(n), 0.0)
    # of blocks of 8, as frames may depend on those before; differences of blocks have no drift
    blocks = np.array([part.mean() for part in np.array_split(series, n // 8)])
    squares = 4 * np.square(np.diff(blocks))
    noise = max(squares.mean(), np.median(squares) / 0.455, 0.5 / standardized.varies.sum())
    time = (numbers - numbers[0])[:, None] / max(numbers[-1] - numbers[0], 1)
    sums = np.cumsum(series[::2] - series[::2].mean())[:-1]
    half = np.arange(1, sums.size + 1)
    place = 2 * (int(np.argmax(sums**2 / (half * (1 - half / (sums.size + 1))))) + 1)
    spectrum = np.abs(np.fft.rfft(series))[_LOWEST_LINE : n // 2]
    angle = 2 * np.pi * (_LOWEST_LINE + int(np.argmax(spectrum))) / n * np.arange(n)[:, None]
    courses = [
        ("drift of", time),
        ("drift of", np.cos(np.pi * np.arange(1, 4) * time)),
        ("step of", (np.arange(n) >= place)[:, None] * 1.0),
        ("", np.hstack((np.cos(angle), np.sin(angle)))),
    ]
    best = _Course("", np.zeros(n), 0.0)
    for kind, columns in courses:
        if kind == "step of" and not 3 <= place <= n - 3:
            continue
        design = np.hstack((np.ones((n, 1)), columns))
        solution = np.linalg.lstsq(design[::2], series[::2], rcond=None)[0]
        before = np.square(series[1::2] - series[::2].mean()).sum()
        gain = float(before - np.square(series[1::2] - design[1::2] @ solution).sum()) / noise
        # waves are many enough to fit a step
        if kind and gain > best.gain * (0.85 if kind == "step of" else 1.0):
            fitted = design @ np.linalg.lstsq(design, series, rcond=None)[0]
            best = _Course(kind, (fitted - fitted.mean()) / (np.ptp(fitted) or 1.0), gain)
        elif not kind and gain > 1.3 * best.gain:
            return best._replace(gain=0.0)
    return best


def check_changes(levels: Sequence[Residual]) -> None:
    """Note drifts and steps (χ² of other frames falls by 25), name what changes, take them out."""
    courses = [_course(level) for level in levels]
    # the clearest says how levels change in which it is not seen
    clearest = max(courses, key=lambda course: course.gain)
    if clearest.gain <= _REAL_GAIN:
        return
    slopes, errors = [], []
    for number, (level, course) in enumerate(zip(levels, courses, strict=True)):
        if course.gain <= _REAL_GAIN:
            times, known = (np.linspace(0, 1, len(one.values)) for one in (course, clearest))
            courses[number] = course._replace(values=np.interp(times, known, clearest.values))
        values, signal = courses[number].values, np.asarray(level.captured.signal, np.float32)
        power = max(float(np.square(values).sum()), 1e-12)
        variance = signal.var(axis=0)[level.good].clip(1 / len(signal)) * level.inflation
        slope = np.tensordot(values.astype(np.float32), signal, 1)[level.good] / power
        slopes.append(np.asarray(slope, np.float64))
        errors.append(np.asarray(np.sqrt(variance / power), np.float64))
    quantity = _quantity(levels, courses, slopes, errors)
    name = _QUANTITIES.get(quantity, "readings")
    verb, at_once = ("drift", "") if clearest.kind == "drift of" else ("change", " at once")
    verb += at_once if name in ("readings", "dark counts") else f"s{at_once}"
    for level, course, slope, error in zip(levels, courses, slopes, errors, strict=True):
        if course.gain <= _REAL_GAIN:
            continue
        course_ = course.values[:, None, None].astype(np.float32)
        size, change = float(slope.mean()), np.zeros(level.good.shape)
        change[level.good] = slope
        if quantity:
            part = level.parts[quantity]
            reach = part[level.good] / error
            size = float(reach @ (slope / error)) / max(float(reach @ reach), 1e-12)
            change = size * part
            level.doubt(quantity, abs(size))
        level.doubt("variance", 0.3 * float(np.square(change[level.good]).mean()) / 12)
        if quantity == "step":
            remove_gain(level, size * course_)
        else:
            level.subtract(course_ * change.astype(np.float32))
        direction = float(np.sign(course.values @ np.arange(len(course.values))))
        amount = _amount(quantity or "offset", size * direction, "+")
        level.note(f"{clearest.kind} {name}", f"{name} {verb} by {amount}")
        if not quantity:
            level.note("none", "what changes is none of the known causes")


def remove_gain(level: Residual, excess: NDArray[Any]) -> None:
    """Divide captured counts by a gain of 1 + excess, (n or 1, rows or 1, columns or 1)."""
    level.captured = level.captured.moved(lambda counts: np.asarray(counts / (1 + excess)))
    level.quiet.add("bit")


def _quantity(
    levels: Sequence[Residual],
    courses: Sequence[_Course],
    slopes: Sequence[Floats],
    errors: Sequence[Floats],
) -> str:
    """Return what changes by one amount in the good pixels (P,) of all levels, or "".

    Slopes and their errors are counts. The best quantity leaves chance, or a tenth of χ², and is
    clearly better than the next. Levels in which it would be seen are those that change.
    """
    sigma = np.concatenate(errors)
    z = np.concatenate(slopes) / sigma
    # one hot or odd pixel proves nothing
    before, left = np.minimum(z**2, 50.0).sum(), {}
    sizes = {}
    for quantity in _QUANTITIES:
        reach = np.concatenate([level.parts[quantity][level.good] for level in levels]) / sigma
        size = float(reach @ z) / max(float(reach @ reach), 1e-12)
        left[quantity] = float(np.minimum((z - size * reach) ** 2, 50.0).sum())
        sizes[quantity] = size
    best, second = sorted(left, key=lambda quantity: left[quantity])[:2]
    chance = z.size + 6 * (2 * z.size) ** 0.5
    is_refuted = left[best] > chance + 0.1 * (before - left[best])
    is_clear = left[second] - left[best] > _CLEARLY_BETTER and best != "light leak"
    for level, course, error in zip(levels, courses, errors, strict=True):
        gain = np.square(sizes[best] * level.parts[best][level.good] / error).sum()
        is_refuted |= bool(course.gain <= _REAL_GAIN and gain > 3 * _REAL_GAIN)
    return best if is_clear and not is_refuted else ""


def _amount(quantity: str, size: float, sign: str = "") -> str:
    return f"{size:{sign}.2g} counts" if quantity == "offset" else f"{100 * size:{sign}.2g} %"


def check_noise(levels: Sequence[Residual]) -> None:
    """Remove flicker and banding (chance 1e-6) and noise that pixels share (6 σ), and note them."""
    for level in levels:
        _remove_lines(level)
        is_line = any(fault.kind in ("flicker", "row banding") for fault in level.faults)
        signal, usual = level.captured.signal, level.expected.signal
        shown, known = Standardized.of(signal, level.good), Standardized.of(usual, level.good)
        share, error = _excess(shown.far_correlation(), known.far_correlation())
        if share > max(_NOISE_Z * error, _SMALLEST_SHARE):
            if is_line or not _is_white(shown.mean):
                level.note("none", "all pixels fluctuate together, and not at random")
                continue
            reach = max(shown.reach(level.parts[level.moving]), 1e-12)
            size = share**0.5 / reach
            # the noise of counting of the mean stays
            kept = min(float(known.mean.std() / max(shown.mean.std(), 1e-12)), 1.0)
            removed = ((1 - kept) * shown.mean / reach)[:, None, None]
            level.subtract(removed * level.parts[level.moving])
            _doubt_rest(level, size / np.sqrt(len(shown.z)), 2 * size)
            amount = _amount(level.moving, size)
            level.note("common noise", f"all pixels fluctuate together by {amount}")
        if is_line:
            continue
        # between the peaks of the comb, noise of the readout is not hidden by that of counting;
        # what was subtracted has moved the peaks
        is_readout_seen = level.captured.codes is not None and not level.uncertainty
        _note_shared(level, shown, known)
        if is_readout_seen:
            fractions = (np.asarray(part - np.rint(part), np.float32) for part in (signal, usual))
            _note_shared(level, *(Standardized.of(part, level.good) for part in fractions))


def _note_shared(level: Residual, shown: Standardized, known: Standardized) -> None:
    """Note noise that all pixels, or those of a row or column, share, each kind once."""
    common, error = shown.far_correlation()
    for name, pixels in (
        ("common", "all pixels"),
        ("row", "pixels of each row"),
        ("column", "pixels of each column"),
    ):
        share, sigma, is_random = common, error, _is_white(shown.mean)
        if name != "common":
            share, sigma = _excess(shown.line_correlation(name), known.line_correlation(name))
            share, sigma = share - max(common, 0.0), float(np.hypot(sigma, error))
            is_random = _are_independent(shown, name)
        is_new = f"{name} noise" not in {fault.kind for fault in level.faults}
        if is_new and is_random and share > max(_NOISE_Z * sigma, _SMALLEST_SHARE):
            noise = share * float(np.square(shown.sigma[level.good]).mean())
            level.uncertainty["variance"] = level.uncertainty.get("variance", 0.0) + 2 * noise
            level.uncertainty["read noise"] = 2 * noise
            level.quiet.add("bit")
            level.note(f"{name} noise", f"{pixels} fluctuate together by {noise**0.5:.2g} counts")


def _excess(seen: tuple[float, float], usual: tuple[float, float]) -> tuple[float, float]:
    """Captured less expected correlation, and its standard error."""
    return seen[0] - usual[0], float(np.hypot(seen[1], usual[1]))


def _remove_lines(level: Residual) -> None:
    """Note up to three lines of the spectrum of all pixels, or of rows, and subtract them."""
    moving, n = level.moving, len(level.captured.readings)
    change = level.parts[moving]
    is_drifting = any(fault.kind.startswith(("drift", "step")) for fault in level.faults)
    for _ in range(3):
        # lost frames count: they would break the phase of a line
        shown, places = level.standardized, level.numbers
        line = _strongest(shown, places)
        if line is None:
            return
        cycles, is_banding = line
        if is_drifting and cycles * n < 12.0:  # cycles that a drift may leave
            level.note("none", "what drifts does so unevenly")
            return
        angle = 2 * np.pi * cycles * places
        waves = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        series, name = shown.mean[:, None], "flicker"
        if is_banding:
            series = shown.z.sum(axis=2) / np.maximum(shown.varies.sum(axis=1), 1)
        amplitudes = np.linalg.lstsq(waves, series, rcond=None)[0]
        if is_banding:
            phasors = amplitudes[0] + 1j * amplitudes[1]
            seen = phasors[np.abs(phasors) > 0.5 * np.abs(phasors).max()]
            # rows of one phase see one flicker
            name = "row banding" if np.abs(seen.mean()) < 0.93 * np.abs(seen).mean() else name
        fitted = waves @ amplitudes / max(shown.reach(change), 1e-12)
        level.subtract(fitted[:, :, None] * change)
        size = float(np.sqrt(2 * np.square(fitted).mean()))
        _doubt_rest(level, size / (np.pi * max(cycles * n, 1.0)), size)
        hertz = cycles / level.captured.interval_s
        level.note(name, f"{name} of {hertz:.3g} Hz, ±{_amount(moving, size)}")


def _doubt_rest(level: Residual, left: float, removed: float) -> None:
    """Note what the removal of a fluctuation of an amplitude leaves uncertain."""
    counts = removed * float(level.parts[level.moving][level.good].mean())
    level.doubt(level.moving, left)
    level.doubt("variance", 0.2 * counts**2 / 2)


def _strongest(standardized: Standardized, places: Ints) -> tuple[float, bool] | None:
    """Cycles per frame of the strongest line of all pixels, or of rows (true), if no chance."""
    n, per_row = int(places[-1]) + 1, standardized.varies.sum(axis=1)
    used = per_row > 0
    if not used.any() or len(standardized.z) < _FEWEST_FRAMES:
        return None
    rows = np.zeros((n, int(used.sum())), standardized.z.dtype)
    rows[places] = standardized.z.sum(axis=2)[:, used] / np.sqrt(per_row[used])
    weight = np.sqrt(per_row[used] / per_row.sum())
    spectra = np.fft.rfft(rows, axis=0)[: (n + 1) // 2]
    slow = float(np.square(np.abs(spectra[1:_LOWEST_LINE])).sum(axis=1).max(initial=0.0))
    spectra = spectra[_LOWEST_LINE:]
    common = spectra @ weight
    of_rows = np.square(np.abs(spectra - common[:, None] * weight)).sum(axis=1)
    power = np.array([np.square(np.abs(common)), of_rows]) / n
    chance = np.array([_chance(power[0], 1), _chance(power[1], rows.shape[1] - 1)])
    chance *= power.shape[1]
    at = int(np.argmin(chance.min(axis=0)))
    if 2 * chance[:, at].min() > _CHANCE:
        return None
    if (chance.min(axis=0) == 0).sum() > 1:
        at = int(np.argmax(power.sum(axis=0)))
    # the spectrum of a slow change falls with the frequency
    if slow > n * power[:, at].sum():
        return None
    is_banding = bool(chance[1, at] < _CHANCE and power[1, at] > 0.2 * power[0, at])
    series = rows if is_banding else (rows @ weight)[:, None]
    cycles, width = float(at + _LOWEST_LINE), 1.0
    for _ in range(2):
        trials = (cycles + width * np.linspace(-1, 1, 61)) / n
        waves = np.exp(-2j * np.pi * trials[:, None] * np.arange(n))
        of_trials = np.square(np.abs(waves @ series)).sum(axis=1)
        cycles, width = float(trials[int(np.argmax(of_trials))]) * n, width / 20
    return cycles / n, is_banding


def _chance(power: Floats, series: float) -> Floats:
    """Chances of as much power of so many independent series, relative to the median."""
    if not series:
        return np.ones_like(power)
    # rows that fluctuate together are fewer
    low, middle, high = np.quantile(power, (0.25, 0.5, 0.75))
    series = min(series, max((1.349 * middle / max(high - low, 1e-300)) ** 2, 0.5))
    scale = max(float(middle) / float(gamma.median(series)), 1e-300)
    return np.asarray(gamma.sf(power / scale, series))


def _are_independent(standardized: Standardized, name: str) -> bool:
    """Return whether the means of rows, or columns, fluctuate independently of each other."""
    lines = standardized.z.sum(axis=2 if name == "row" else 1, dtype=np.float64)
    lines = lines - lines.mean(axis=1, keepdims=True)
    size = np.sqrt(np.square(lines).sum(axis=0))
    lines = lines[:, size > 0] / size[size > 0]
    many = lines.shape[1]
    if many < 4:
        return False
    alike = (lines.T @ lines)[np.triu_indices(many, 1)] + 1 / (many - 1)
    return bool(np.square(alike).mean() < 2.0 / len(lines))


def _is_white(series: Floats) -> bool:
    """Return whether values (n,) do not depend on those before."""
    z = (series - series.mean()) / max(float(series.std()), 1e-12)
    shares = [float((z[lag:] * z[:-lag]).mean()) for lag in range(1, 2 * _LAGS)]
    return bool(np.abs(shares).max() < 5.0 / np.sqrt(len(z)))
