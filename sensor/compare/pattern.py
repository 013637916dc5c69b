"""Faults of lines and single pixels, listed and located.

    dead               almost no counts, though many are expected; a whole line: dead row, column
    stuck              one reading in all frames of all recordings, which is not that of no counts
    line               rows and columns that differ by one voltage (offset), or in proportion to
                       light, dark counts or both
    telegraph noise    readings correlated from frame to frame, over and above other pixels
    hot, deviating     single pixels far from what the others' means let expect

Differences of pixels from a robust fit to their expected means, these squared, and the means of
their neighbors, in standard errors, show lines and pixels in spite of a wrong global parameter. The
standard error is that of counting and calibration, or the scatter of pixels about that fit where
larger.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from megalopta.core.arrays import Floats, Mask, mean_and_variance, robust_sigma
from megalopta.sensor.calibrate.bad_pixels import constant_pixels, dead_pixels
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.compare.faults import Fault, listed, pixels_of
from megalopta.sensor.compare.in_time import Parts

_OF_LINE = 0.75
"""Share of a line's pixels above which the fault is the line's."""
_LINE_Z = 6.0
_SMALLEST_OF_LINE = (0.03, 0.05)
"""Smallest relative difference of a line, and smallest offset (counts)."""
_PIXEL_Z = 8.0
_LARGE = 0.1
"""Relative difference above which a pixel is listed."""
_HOT = 2.0
"""Dark counts over the expected ones above which a pixel is hot."""
_ROUNDS = 8


class Deviations(NamedTuple):
    """Means of pixels at one level less the robust parabola through expected ones."""

    counts: Floats
    """(rows, columns)"""
    error: Floats


def unresponsive(
    captured: Sequence[Level], expected: Sequence[Level]
) -> tuple[Mask, Mask, list[Fault]]:
    """Find dead and stuck pixels, (rows, columns) each, and their lines."""
    frozen = constant_pixels([level.recorded for level in captured])
    frozen &= ~constant_pixels([level.recorded for level in expected])
    counts, reference = (
        np.sum([_sum(level) for level in levels], axis=0) for levels in (captured, expected)
    )
    dead = dead_pixels(counts, reference)
    stuck = frozen & ~dead
    found = []
    rest = dead | stuck
    for name, axis in (("row", 1), ("column", 0)):
        lines = (dead | stuck).mean(axis=axis) > _OF_LINE
        if lines.any() and not lines.all():
            plural = name + ("s" if lines.sum() > 1 else "")
            text = f"dead {plural} {listed(np.flatnonzero(lines))}"
            found.append(Fault(f"dead {name}", text))
            rest &= ~(lines[:, None] if name == "row" else lines[None, :])
    if (rest & dead).any():
        found.append(Fault("dead pixel", f"dead {pixels_of(rest & dead)}"))
    if (rest & stuck).any():
        reading = captured[0].recorded[0][rest & stuck]
        kind = "reading" if captured[0].codes is None else "code"
        text = f"stuck {pixels_of(rest & stuck)}, at {kind} {listed(reading)}"
        found.append(Fault("stuck pixel", text))
    return dead, stuck, found


def _sum(level: Level) -> Floats:
    return np.asarray(level.signal.sum(axis=0, dtype=np.float64))


def deviations(captured: Level, expected: Level, good: Mask, error: Floats) -> Deviations:
    """Return the deviations of pixels at a level; `error` is that of the calibration, in counts."""
    means, parts = [], np.square(np.broadcast_to(error, good.shape)).astype(float)
    for level in (captured, expected):
        mean, variance = mean_and_variance(level.signal)
        frames = len(level.signal)
        parts += np.maximum(variance, mean.clip(0)) / frames + 1 / frames**2
        means.append(mean)
    apart, sigma = means[0] - means[1], np.sqrt(parts)
    scale = max(float(np.abs(means[1]).max()), 1e-12)
    columns = np.stack(
        [*((means[1] / scale) ** power for power in range(3)), _neighbors(means[1]) / scale],
        axis=-1,
    )
    trend = columns @ robust_fit(columns[good], apart[good], sigma[good])
    # pixels that counted nothing may have counted as much as the trend
    sigma = np.sqrt(parts + np.abs(trend) / len(captured.readings))
    left = np.where(good, apart - trend, 0)
    z = left[good] / sigma[good]
    scatter = max(robust_sigma(z), 1.0) if z.size else 1.0
    return Deviations(left, scatter * sigma)


def _neighbors(means: Floats) -> Floats:
    """Sum of the four neighbors, whose crosstalk is no fault of a pixel; 0 beyond the border."""
    wide = np.pad(means, 1)
    return np.asarray(wide[:-2, 1:-1] + wide[2:, 1:-1] + wide[1:-1, :-2] + wide[1:-1, 2:])


def robust_fit(columns: Floats, values: Floats, sigma: Floats) -> Floats:
    """Combination of columns nearest to values, by iterated least squares (Huber's weights)."""
    weight: Floats = 1 / sigma
    solution: Floats = np.zeros(columns.shape[-1])
    for _ in range(_ROUNDS):
        weighted = columns * weight[:, None]
        solution = np.asarray(np.linalg.lstsq(weighted, values * weight, rcond=None)[0])
        left = np.abs(values - columns @ solution) / sigma
        weight = np.asarray(1 / sigma / np.sqrt(np.maximum(left, 1)))
    return solution


class LineOffset(NamedTuple):
    """Row or column with its own offset."""

    axis: int
    """0 for a row, 1 for a column"""
    place: int
    counts: float


def odd_lines(
    captured: Sequence[Level], found: Sequence[Deviations], good: Sequence[Mask],
    parts: Sequence[Parts], volts_per_count: float,
) -> tuple[list[LineOffset], Mask, list[Fault]]:  # fmt: skip
    """Find rows and columns that differ; return offsets, other odd lines' pixels, and faults."""
    shape = good[0].shape
    offsets, masked, faults = [], np.zeros(shape, np.bool_), []
    for axis, name in ((0, "row"), (1, "column")):
        turned = [_turned(each.counts / each.error, own, axis)
                  for each, own in zip(found, good, strict=True)]  # fmt: skip
        z = np.array(turned)
        for index in np.flatnonzero((np.abs(z) > _LINE_Z).any(axis=0)):
            take = (index, slice(None)) if axis == 0 else (slice(None), index)
            cause, size = _cause_of_line(found, good, parts, take)
            if abs(size) < _SMALLEST_OF_LINE[cause == "offset"]:
                continue
            if cause == "offset":
                offsets.append(LineOffset(axis, int(index), size))
                unit = f"{size:+.2g} counts"
                if volts_per_count:  # counts lower the output
                    unit = f"{-1e3 * size * volts_per_count:+.2g} mV"
                faults.append(Fault(f"{name} offset", f"{name} {index} is offset by {unit}"))
            else:
                masked[take] = True
                what = {"gain": "gain", "light": "efficiency", "dark counts": "dark count rate"}[
                    cause
                ]
                text = f"{what} of {name} {index} differs by {100 * size:+.2g} %"
                faults.append(Fault(f"odd {name}", text))
    return offsets, masked, faults


def _turned(z: Floats, good: Mask, axis: int) -> Floats:
    """Median of z over the good pixels of each line, in its standard errors."""
    lines = np.where(good, z, np.nan) if axis == 0 else np.where(good, z, np.nan).T
    number = np.isfinite(lines).sum(axis=1)
    medians = np.zeros(len(lines))
    enough = number > 3
    if enough.any():
        medians[enough] = np.nanmedian(lines[enough], axis=1)
    others = medians - np.median(medians)
    # lines of hot pixels scatter more than counting explains
    scatter = robust_sigma(others)
    return np.asarray(others / np.maximum(1.2533 / np.sqrt(np.maximum(number, 1)), scatter))


def _cause_of_line(
    found: Sequence[Deviations], good: Sequence[Mask], parts: Sequence[Parts], take: Any,
) -> tuple[str, float]:  # fmt: skip
    """Best of four causes, and its size."""
    misfits: Mapping[str, tuple[float, float]] = {}
    best: dict[str, tuple[float, float]] = dict(misfits)
    for cause in ("offset", "light", "dark counts", "gain"):
        products = squares = total = 0.0
        for each, own, part in zip(found, good, parts, strict=True):
            use = own[take]
            x, y = part.shape_of(cause)[take][use], each.counts[take][use]
            w = 1 / each.error[take][use] ** 2
            products += float((w * x * y).sum())
            squares += float((w * x * x).sum())
            total += float((w * y * y).sum())
        if squares > 0:
            best[cause] = total - products**2 / squares, products / squares
    cause = min(best, key=lambda each: best[each][0])
    return cause, best[cause][1]


def telegraph_fault(mask: Mask) -> list[Fault]:
    """Describe pixels with telegraph noise."""
    return [Fault("telegraph noise", f"telegraph noise in {pixels_of(mask)}")] if mask.any() else []


def odd_pixels(
    captured: Sequence[Level], expected: Sequence[Level], found: Sequence[Deviations],
    good: Sequence[Mask], parts: Sequence[Parts],
) -> tuple[Mask, list[Fault]]:  # fmt: skip
    """Mark and describe single pixels that deviate."""
    hot = np.zeros(good[0].shape, np.bool_)
    odd = np.zeros_like(hot)
    for one, other, each, own, part in zip(captured, expected, found, good, parts, strict=True):
        reference = np.asarray(other.signal.mean(axis=0, dtype=np.float64))
        far = own & (np.abs(each.counts) > _PIXEL_Z * each.error)
        far &= np.abs(each.counts) > _LARGE * np.maximum(reference, 0)
        odd |= far
        if one.is_dark:
            hot |= far & (each.counts > (_HOT - 1) * part.dark)
    faults = []
    if hot.any():
        faults.append(Fault("hot pixel", f"hot {pixels_of(hot)}"))
    if (odd & ~hot).any():
        text = f"{pixels_of(odd & ~hot)} differ in their mean from all others"
        faults.append(Fault("deviating pixel", text))
    return hot | odd, faults
