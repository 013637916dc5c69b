"""Faults of lines and single pixels, and uneven light, from deviations of the means of pixels.

Uneven light is a surface of mean 0 in the lit recordings; a smooth efficiency would look the same.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from megalopta.core.arrays import Floats, Mask, mean_and_variance, robust_sigma
from megalopta.sensor.calibrate.pixels import constant_pixels, dead_pixels
from megalopta.sensor.compare.faults import Fault, listed, pixels_of
from megalopta.sensor.compare.residual import Residual


class Deviations(NamedTuple):
    """Means of good pixels at one level less the robust parabola through expected ones."""

    counts: Floats
    """(rows, columns)"""
    error: Floats
    good: Mask
    parts: dict[str, Floats]
    """As of the level"""
    is_dark: bool


def unresponsive(levels: Sequence[Residual]) -> tuple[Mask, list[Fault]]:
    """Find dead and stuck pixels (rows, columns), and their lines."""
    captured, expected = (
        [getattr(level, side) for level in levels] for side in ("captured", "expected")
    )
    frozen = constant_pixels([level.recorded for level in captured])
    frozen &= ~constant_pixels([level.recorded for level in expected])
    counts, reference = (
        np.sum([level.signal.sum(axis=0, dtype=np.float64) for level in recordings], axis=0)
        for recordings in (captured, expected)
    )
    dead = dead_pixels(counts, reference)
    stuck = frozen & ~dead
    faults = []
    single = dead | stuck
    for name, axis in (("row", 1), ("column", 0)):
        # the fault is the line's, not the pixels'
        lines = (dead | stuck).mean(axis=axis) > 0.75
        if lines.any() and not lines.all():
            plural = name + ("s" if lines.sum() > 1 else "")
            text = f"dead {plural} {listed(np.flatnonzero(lines))}"
            faults.append(Fault(f"dead {name}", text))
            single &= ~(lines[:, None] if name == "row" else lines[None, :])
    if (single & dead).any():
        faults.append(Fault("dead pixel", f"dead {pixels_of(single & dead)}"))
    if (single & stuck).any():
        reading = captured[0].recorded[0][single & stuck]
        kind = "reading" if captured[0].codes is None else "code"
        text = f"stuck {pixels_of(single & stuck)}, at {kind} {listed(reading)}"
        faults.append(Fault("stuck pixel", text))
    return dead | stuck, faults


def deviations(level: Residual) -> Deviations:
    """Return the deviations of the pixels of a level."""
    good = level.good
    means, squares = [], np.square(np.broadcast_to(level.error, good.shape)).astype(float)
    for recording in (level.captured, level.expected):
        mean, variance = mean_and_variance(recording.signal)
        frames = len(recording.signal)
        squares += np.maximum(variance, mean.clip(0)) / frames + 1 / frames**2
        means.append(mean)
    difference, sigma = means[0] - means[1], np.sqrt(squares)
    scale = max(float(np.abs(means[1]).max()), 1e-12)
    # the four neighbors, whose crosstalk is no fault of a pixel; 0 beyond the border
    wide = np.pad(means[1], 1)
    neighbors = wide[:-2, 1:-1] + wide[2:, 1:-1] + wide[1:-1, :-2] + wide[1:-1, 2:]
    columns = np.stack(
        [*((means[1] / scale) ** power for power in range(3)), neighbors / scale], axis=-1
    )
    trend = columns @ _robust_fit(columns[good], difference[good], sigma[good])
    # pixels that counted nothing may have counted as much as the trend
    sigma = np.sqrt(squares + np.abs(trend) / len(level.captured.readings))
    counts = np.where(good, difference - trend, 0)
    z = counts[good] / sigma[good]
    scatter = max(robust_sigma(z), 1.0) if z.size else 1.0
    return Deviations(counts, scatter * sigma, good, level.parts, level.captured.is_dark)


def _robust_fit(columns: Floats, values: Floats, sigma: Floats) -> Floats:
    """Combination of columns nearest to values, by iterated least squares (Huber's weights)."""
    weight: Floats = 1 / sigma
    solution: Floats = np.zeros(columns.shape[-1])
    for _ in range(8):
        weighted = columns * weight[:, None]
        solution = np.asarray(np.linalg.lstsq(weighted, values * weight, rcond=None)[0])
        left = np.abs(values - columns @ solution) / sigma
        weight = np.asarray(1 / sigma / np.sqrt(np.maximum(left, 1)))
    return solution


def uneven_light(deviating: Sequence[Deviations]) -> tuple[Floats, Fault] | None:
    """Return light relative to its mean, less 1, (rows, columns), if it is uneven."""
    lit = [level for level in deviating if not level.is_dark]
    if not lit:
        return None
    y, x = np.meshgrid(*(np.linspace(-1, 1, side) for side in lit[0].good.shape), indexing="ij")
    shapes = np.stack((x, y, x * y, x**2, y**2), axis=-1)
    shapes -= shapes.mean(axis=(0, 1))
    columns, values, sigma = (
        np.concatenate([part[level.good] for part, level in zip(maps, lit, strict=True)])
        for maps in (
            [shapes * level.parts["efficiency"][:, :, None] for level in lit],
            [level.counts for level in lit],
            [level.error for level in lit],
        )
    )
    if len(values) < 50:
        return None
    solution = _robust_fit(columns, values, sigma)
    surface = np.asarray(shapes @ solution)
    span = float(np.ptp(surface))
    # of five coefficients; chance exceeds it once in 1e11
    if np.sum((columns @ solution / sigma) ** 2) < 60.0 or span < 0.03:
        return None
    return surface, Fault(
        "uneven light", f"the light is uneven, by {100 * span:.2g} % over the array"
    )


_NAMES = {"step": "gain", "efficiency": "efficiency", "dark counts": "dark count rate"}


def odd_lines(
    deviating: Sequence[Deviations], volts_per_count: float
) -> tuple[list[Floats], Mask, list[Fault]]:
    """Find rows and columns that differ.

    Returns the counts (rows, columns) of each offset, other odd lines' pixels, and faults.
    """
    shape = deviating[0].good.shape
    offsets, masked, faults = [], np.zeros(shape, np.bool_), []
    for axis, name in ((0, "row"), (1, "column")):
        z = np.array([_line_z(level, axis) for level in deviating])
        for index in np.flatnonzero((np.abs(z) > 6.0).any(axis=0)):
            line = np.zeros(shape, np.bool_)
            line[(index,) if axis == 0 else (slice(None), index)] = True
            # best of four causes, and its size
            cause, size, smallest = "offset", 0.0, np.inf
            for parameter in ("offset", "efficiency", "dark counts", "step"):
                products = squares = total = 0.0
                for level in deviating:
                    use = line & level.good
                    x, y = level.parts[parameter][use], level.counts[use]
                    w = 1 / level.error[use] ** 2
                    products += float((w * x * y).sum())
                    squares += float((w * x * x).sum())
                    total += float((w * y * y).sum())
                if squares > 0 and total - products**2 / squares < smallest:
                    cause, size = parameter, products / squares
                    smallest = total - products**2 / squares
            if cause == "offset" and abs(size) >= 0.05:  # counts
                offsets.append(np.where(line, size, 0.0))
                unit = f"{size:+.2g} counts"
                if volts_per_count:  # counts lower the output
                    unit = f"{-1e3 * size * volts_per_count:+.2g} mV"
                faults.append(Fault(f"{name} offset", f"{name} {index} is offset by {unit}"))
            elif cause != "offset" and abs(size) >= 0.03:  # relative
                masked |= line
                text = f"{_NAMES[cause]} of {name} {index} differs by {100 * size:+.2g} %"
                faults.append(Fault(f"odd {name}", text))
    return offsets, masked, faults


def _line_z(level: Deviations, axis: int) -> Floats:
    """Median of z over the good pixels of each line, in its standard errors."""
    lines = np.where(level.good, level.counts / level.error, np.nan)
    lines = lines if axis == 0 else lines.T
    number = np.isfinite(lines).sum(axis=1)
    medians = np.zeros(len(lines))
    enough = number > 3
    if enough.any():
        medians[enough] = np.nanmedian(lines[enough], axis=1)
    medians -= np.median(medians)
    # lines of hot pixels scatter more than counting explains
    scatter = robust_sigma(medians)
    return np.asarray(medians / np.maximum(1.2533 / np.sqrt(np.maximum(number, 1)), scatter))


def odd_pixels(levels: Sequence[Residual]) -> tuple[Mask, list[Fault]]:
    """Mark and describe single pixels that deviate."""
    hot, odd = np.zeros((2, *levels[0].masked.shape), np.bool_)
    for level in levels:
        deviating = deviations(level)
        reference = level.expected.signal.mean(axis=0, dtype=np.float64)
        far = deviating.good & (np.abs(deviating.counts) > 8.0 * deviating.error)
        far &= np.abs(deviating.counts) > 0.1 * np.maximum(reference, 0)
        odd |= far
        if deviating.is_dark:
            hot |= far & (deviating.counts > deviating.parts["dark counts"])
    faults = []
    if hot.any():
        faults.append(Fault("hot pixel", f"hot {pixels_of(hot)}"))
    if (odd & ~hot).any():
        text = f"{pixels_of(odd & ~hot)} differ in their mean from all others"
        faults.append(Fault("deviating pixel", text))
    return hot | odd, faults
