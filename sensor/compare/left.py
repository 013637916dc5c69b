"""Statistics in which captured and expected frames still differ, whatever the cause.

**Statistics** of a level, over its good pixels and in each of `BLOCKS` blocks of frames. Readings
are standardized by the expected mean and σ of their pixel.

    mean, variance             of all, and their contrasts between halves, odd and even lines
    skewness, tails            third and fourth powers
    lag 1 … 6                  products with the frames before
    neighbors                  products with pixels beside, by direction
    frame, row, column, tile   squared means of what fluctuates together
    bit 0 … 3                  share of readings with this bit

Their scatter over blocks gives their errors, also where frames are no independent draws.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, f, norm, t

from megalopta.core.arrays import Floats, Mask, robust_sigma
from megalopta.core.compiling import compiled
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.compare.residual import Residual
from megalopta.sensor.compare.two_sample import BLOCKS, Sample, mean_test, variance_test

CHANCE = 4e-6
"""Chance of one statistic, or picture, below which something is left."""
_FORGIVEN = {"mean": 2e-3, "variance": 1e-2, "neighbors": 2e-3, "lag": 2e-3}
"""Errors of the model: of means relative to them, of the others relative to the variance"""
_TILE = 4
_SLOW = 3
"""Cosines of which slow changes are made"""
_BESIDE = ((0, 1), (1, 0), (1, 1), (0, 2), (2, 0))


class Left(NamedTuple):
    """A statistic of one level that differs."""

    name: str
    level: Level
    size: float
    """Captured less expected, in units of σ, or of the variance"""
    z: float
    """Size in standard errors."""


class Whole(NamedTuple):
    """Moments of all frames of a recording of which some are compared one by one."""

    pixels: Sample
    rows: Floats
    """Mean of each row of each frame, (n, rows)"""
    columns: Floats

    @classmethod
    def of(cls, signal: NDArray[Any]) -> "Whole":
        """Read the frames (n, rows, columns) in blocks, as they may be mapped from a file."""
        n, *shape = signal.shape
        sums, rows, columns = map(np.zeros, ((2, *shape), (n, shape[0]), (n, shape[1])))
        for start in range(0, n, 32):
            part = slice(start, start + 32)
            _add(np.asarray(signal[part], np.float32), sums, rows[part], columns[part])
        mean = sums[0] / n
        variance = np.maximum(sums[1] / n - mean**2, 0) * n / (n - 1)
        return cls(Sample(mean, variance, n), rows / shape[1], columns / shape[0])

    def unsteady(self, level: Level) -> list[Left]:
        """Return the lines, and all pixels, whose means change from block to block of frames."""
        misfits = []
        all_ = self.rows.mean(axis=1, keepdims=True)
        series = {"all pixels": all_, "rows": self.rows, "columns": self.columns}
        for name, means in series.items():
            blocks = np.array_split(means, BLOCKS)
            within = np.mean([block.var(axis=0, ddof=1) for block in blocks], axis=0)
            between = np.var([block.mean(axis=0) for block in blocks], axis=0, ddof=1)
            ratio = between * len(means) / BLOCKS / np.maximum(within, 1e-12)
            p = f.sf(ratio / 1.05, BLOCKS - 1, len(means) - BLOCKS)
            misfits += _rarest(f"time in {name} of all frames", level, p)
        return misfits


@compiled(fastmath={"reassoc", "contract"})
def _add(frames: NDArray[np.float32], sums: Floats, of_rows: Floats, of_columns: Floats) -> None:
    """Add readings and their squares, and sums of rows and columns of each frame."""
    for row in range(frames.shape[1]):
        for frame in range(frames.shape[0]):
            total = 0.0
            for column in range(frames.shape[2]):
                value = np.float64(frames[frame, row, column])
                total += value
                sums[0, row, column] += value
                sums[1, row, column] += value * value
                of_columns[frame, column] += value
            of_rows[frame, row] = total


def patterns(shape: tuple[int, int]) -> dict[str, Floats]:
    """Return maps of ±1 whose means contrast the parts of an array, (rows, columns) each."""
    row, column = np.indices(shape)
    parts = {
        "odd and even rows": row % 2 == 0,
        "odd and even columns": column % 2 == 0,
        "the fields of a chessboard": (row + column) % 2 == 0,
        "upper and lower half": row < shape[0] / 2,
        "left and right half": column < shape[1] / 2,
    }
    return {name: np.where(part, 1.0, -1.0) for name, part in parts.items()}


def statistics(
    level: Level, good: Mask, mean: NDArray[np.float32], sigma: NDArray[np.float32]
) -> dict[str, Floats]:
    """Return the statistics of a level, (blocks,) each, by the expected mean and σ of pixels."""
    shape, rows = good.shape, good.sum(axis=1).clip(1)[:, None]
    many, columns = max(int(good.sum()), 1), good.sum(axis=0).clip(1)
    weight = np.where(good, 1 / np.maximum(sigma, 1e-6), 0).astype(np.float32)
    own = level.signal.mean(axis=0, dtype=np.float64).astype(np.float32)
    contrasts = patterns(shape)
    off = (own - mean) * weight
    blocks: dict[str, list[float]] = {}

    def note(name: str, value: Any) -> None:
        blocks.setdefault(name, []).append(float(value))

    for start, end in pairwise(np.linspace(0, len(level.readings), BLOCKS + 1).astype(int)):
        z = (np.asarray(level.signal[start:end], np.float32) - own) * weight
        n, square = len(z), np.square(z)
        maps = {"mean": z.mean(axis=0) + off, "variance": square.mean(axis=0)}
        maps["lag 1"] = (z[1:] * z[:-1]).sum(axis=0) / max(n - 1, 1)
        for name, values in maps.items():
            note(name, values.sum() / many)
            for part, contrast in contrasts.items():
                note(f"{name} of {part}", (values * contrast).sum() / many)
        note("skewness", (z * np.minimum(square, 36)).sum() / n / many)
        note("tails", np.minimum(square * square, 100).sum() / n / many)
        for lag in range(2, 7):
            note(f"lag {lag}", (z[lag:] * z[:-lag]).sum() / max(n - lag, 1) / many)
        for down, right in _BESIDE:
            near = z[:, down:, right:] * z[:, : shape[0] - down, : shape[1] - right]
            note(f"neighbors {down} down, {right} right", near.sum() / n / many)
        note("frame", np.square(z.sum(axis=(1, 2))).mean() / many)
        for part, contrast in contrasts.items():
            note(f"frame of {part}", np.square(np.tensordot(z, contrast, 2)).mean() / many)
        note("row", (np.square(z.sum(axis=2)) / rows.T).mean())
        note("column", (np.square(z.sum(axis=1)) / columns).mean())
        tall, wide = shape[0] // _TILE * _TILE, shape[1] // _TILE * _TILE
        tiles = z[:, :tall, :wide].reshape(n, tall // _TILE, _TILE, wide // _TILE, _TILE)
        note("tile", np.square(tiles.sum(axis=(2, 4))).mean() / _TILE**2)
        recorded = level.recorded[start:end]
        if recorded.dtype.kind in "iu":
            for bit in range(4):
                note(f"bit {bit}", (recorded[:, good] >> bit & 1).mean() if good.any() else 0.0)
    return {name: np.array(values) for name, values in blocks.items()}


def left_of(level: Residual, quiet: Sequence[str] = ()) -> list[Left]:
    """Return what a level's frames still differ in, but for statistics that begin with `quiet`."""
    quiet = (*quiet, *level.quiet)
    good = level.good
    if good.sum() < 2:
        return []
    mean = np.asarray(level.expected_mean, np.float32)
    # of both, so that neither is standardized by its own
    spread = np.asarray(level.captured.signal, np.float32).std(axis=0)
    sigma = np.asarray(np.hypot(level.expected_sigma, spread) / 2**0.5, np.float32)
    captured, expected = (
        statistics(frames, good, mean, sigma) for frames in (level.captured, level.expected)
    )
    misfits = []
    signal = float((level.expected_mean[good] / np.maximum(sigma[good], 1e-6)).mean())
    for name in captured.keys() & expected.keys():
        if name.startswith(tuple(quiet)):
            continue
        first, second = captured[name], expected[name]
        change = float(first.mean() - second.mean())
        kind = name.split()[0]
        forgiven = _FORGIVEN.get(kind, 0.0) * (signal if kind == "mean" else 1.0)
        if kind in ("skewness", "tails"):
            forgiven = 0.03 * abs(float(second.mean()))
        # more light changes what is correlated, and not by which share
        doubts = level.doubts(kind)
        if kind in ("lag", "neighbors"):
            doubts = min(doubts, 0.05) * abs(float(second.mean()))
        forgiven = float(np.hypot(forgiven, doubts))
        counted = (first.var(ddof=1) + second.var(ddof=1)) / BLOCKS
        error = float(np.sqrt(counted + forgiven**2))
        if error <= 0:
            continue
        freedom = 2 * (BLOCKS - 1) if forgiven**2 < counted else 1000
        p = float(2 * t.sf(abs(change) / error, freedom))
        if p < CHANCE:
            misfits.append(Left(name, level.captured, change, float(norm.isf(p / 2) if p else 40)))
    misfits += _maps_left(level, quiet)
    return sorted(misfits, key=lambda one: -one.z)


def _maps_left(level: Residual, quiet: Sequence[str]) -> list[Left]:
    """Maps of means and variances whose pixels scatter more than by chance."""
    first, second = Sample.of(level.captured.signal), Sample.of(level.expected.signal)
    misfits = []
    tests = {
        "mean of pixels": mean_test(first, second, np.hypot(level.error, level.doubted)),
        "variance of pixels": variance_test(first, second, level.error),
    }
    for name, p in tests.items():
        p = p[level.good & np.isfinite(p)].clip(1e-300, 1)
        if name.startswith(tuple(quiet)) or p.size < 16:
            continue
        # of few counts p is coarse, and its sum too small: never a false alarm
        scatter = float(np.minimum(norm.isf(p / 2) ** 2, 50).sum())
        chance = min(float(chi2.sf(scatter / 1.02, p.size)), float(p.min()) * p.size)
        if chance < CHANCE:
            z = float(norm.isf(max(chance, 1e-300)))
            misfits.append(Left(name, level.captured, scatter / p.size, z))
    return misfits


def unsteady(level: Residual) -> list[Left]:
    """Return the parts of the array whose mean changes in time more than by chance.

    Means of blocks of frames scatter by the variance within blocks, of which χ² has a chance.
    """
    good, misfits = level.good, []
    if good.sum() < 16 or len(level.captured.readings) < 4 * BLOCKS:
        return []
    sums: list[dict[str, tuple[Floats, Floats]]] = []
    noise: list[tuple[NDArray[np.float32], Mask]] = []
    for frames in (level.captured, level.expected):
        signal = np.asarray(frames.signal, np.float32)
        blocks = np.array_split(signal, BLOCKS)
        means = np.array([block.mean(axis=0) for block in blocks], np.float64)
        within = np.mean([block.var(axis=0, ddof=1) for block in blocks], axis=0)
        number = len(signal) / BLOCKS
        weight = np.where(good & (within > 0), 1 / np.maximum(within, 1 / len(signal)), 0)
        # of each part, the sum weighted by precision
        shifts = (means - means.mean(axis=0)) * np.sqrt(weight * number)
        sums.append(_sums_of_parts(shifts, (weight > 0).astype(float)))
        z = np.asarray((signal - signal.mean(axis=0)) * np.sqrt(weight), np.float32)
        noise.append((z, weight > 0))
    usual_noise = {
        name: float((np.square(values).sum() / np.maximum(np.sum(number), 1)) / len(values))
        for name, (values, number) in _of_parts(*noise[1]).items()
    }
    # what standardizing by the same frames does to products of many pixels
    z, used = noise[1]
    of_expected = np.where(used, (z[1:] * z[:-1]).sum(axis=0), 0).sum() / max(used.sum(), 1)
    bias = float(of_expected) if len(z) == len(noise[0][0]) else -1.0
    misfits += _lines_of_parts(level, *noise[0], usual_noise, bias)
    for name, (all_, slow) in sums[0].items():
        for squares, usual, freedom in (
            (all_, sums[1][name][0], BLOCKS - 1),
            (slow, sums[1][name][1], _SLOW),
        ):
            ratio = squares / np.maximum(usual / freedom, 1.0) if usual.size == 1 else squares
            p = chi2.sf(ratio / 1.05, freedom)
            misfits += _rarest(f"time in {name}", level.captured, p)
        if name == "pixels":
            total = chi2.sf(all_.sum() / 1.05, all_.size * (BLOCKS - 1))
            if all_.sum() > 1.1 * sums[1][name][0].sum():
                misfits += _rarest("time of pixels", level.captured, np.array([total]))
    return misfits


def _lines_of_parts(
    level: Residual, z: NDArray[Any], used: Mask, usual: Mapping[str, float], bias: float
) -> list[Left]:
    """Noise, and lines in the spectra, of parts of the array."""
    misfits = []
    lags = _of_parts((z[1:] * z[:-1]).sum(axis=0, keepdims=True), used)
    for name, (series, number) in _of_parts(z, used).items():
        series = series.reshape(len(z), -1)
        if name == "pixels":
            # a mean spectrum is of at most 2¹⁴ pixels
            misfits += _lines_of_pixels(level, series[:, np.ravel(used)][:, : 2**14])
            continue
        # readings less their mean are correlated by −1/n
        near = (np.ravel(lags[name][0]) - bias * np.ravel(number)) / np.sqrt(
            np.maximum(np.ravel(number), 1) * len(z)
        )
        doubt = np.hypot(1, (bias != -1.0) * np.sqrt(np.ravel(number) / max(used.sum(), 1)))
        p = 2 * norm.sf(np.abs(near) / doubt / max(usual[name], 1.0))
        misfits += _rarest(f"lag of {name}", level.captured, p)
        squares = np.square(series).sum(axis=0) / np.maximum(np.ravel(number), 1)
        p = chi2.sf(squares / max(usual[name], 1.0) / 1.01, len(z) - 1)
        misfits += _rarest(f"noise of {name}", level.captured, p)
        power = np.square(np.abs(np.fft.rfft(series, axis=0)[2:-1]))
        typical = np.median(power, axis=0) / np.log(2)
        largest = (power / np.where(typical > 0, typical, np.inf)).max(axis=0)
        # relative to a median that is itself uncertain
        p = np.exp(np.log(power.shape[0]) - largest / 1.15)
        misfits += _rarest(f"time in {name}, a line", level.captured, p)
    return misfits


def _rarest(name: str, level: Level, p: Floats) -> list[Left]:
    """Return a statistic if the smallest of its p-values is no chance; its size says which."""
    chance = float(p.min()) * p.size
    z = float(norm.isf(max(chance, 1e-300)))
    return [Left(name, level, float(np.argmin(p)), z)] if chance < CHANCE else []


def _lines_of_pixels(level: Residual, z: NDArray[Any]) -> list[Left]:
    """Lines of the mean spectrum of pixels (n, P), whatever their phases."""
    if not z.size:
        return []
    power = np.square(np.abs(np.fft.rfft(z, axis=0)[2:-1])).mean(axis=1, dtype=np.float64)
    typical = np.median(power)
    if not typical > 0:
        return []
    far = (power / typical - 1) * np.sqrt(z.shape[1])
    excess = float(far.max() / max(robust_sigma(far - np.median(far)), 1.0))
    return [Left("time of pixels, a line", level.captured, 0.0, excess)] if excess > 7.0 else []


def _sums_of_parts(shifts: Floats, used: Floats) -> dict[str, tuple[Floats, Floats]]:
    """Sums of squares over blocks of frames of the sums of parts, and of slow changes."""
    times = (np.arange(BLOCKS) + 0.5) / BLOCKS
    slow = np.cos(np.pi * np.arange(1, _SLOW + 1)[:, None] * times) * (2 / BLOCKS) ** 0.5
    sums = {}
    for name, (values, number) in _of_parts(shifts, used).items():
        z = values.reshape(BLOCKS, -1) / np.sqrt(np.maximum(number, 1)).ravel()
        sums[name] = np.square(z).sum(axis=0), np.square(slow @ z).sum(axis=0)
    return sums


def _of_parts(shifts: NDArray[Any], used: NDArray[Any]) -> dict[str, tuple[Floats, Floats]]:
    """Sums over parts of the array of values (n, rows, columns), and their numbers of pixels."""
    shape = used.shape
    row, column = np.indices(shape)
    parts = {"pixels": (shifts, used)}
    for name, axis in (("rows", 2), ("columns", 1)):
        parts[name] = shifts.sum(axis=axis), used.sum(axis=axis - 1)
    for pieces in (2, 4):
        tall, wide = (max(side // pieces, 1) for side in shape)
        height, width = shape[0] // tall * tall, shape[1] // wide * wide
        tiled = (-1, height // tall, tall, width // wide, wide)
        parts[f"blocks of {tall} × {wide}"] = (
            shifts[:, :height, :width].reshape(tiled).sum(axis=(2, 4)),
            used[:height, :width].reshape(tiled[1:]).sum(axis=(1, 3)),
        )
    masks = {"all pixels": row >= 0, "a chessboard": (row + column) % 2 == 0}
    for name, index in (("rows", row), ("columns", column)):
        masks |= {f"even {name}": index % 2 == 0, f"odd {name}": index % 2 == 1}
        middle = index.max() / 2
        masks |= {f"first half of {name}": index < middle, f"second half of {name}": index > middle}
    for name, mask in masks.items():
        parts[name] = (shifts * mask).sum(axis=(1, 2)), (used * mask).sum()
    return parts


def left_of_all(levels: Sequence[Residual]) -> list[Left]:
    """Return what all levels are left with."""
    return [one for level in levels for one in left_of(level)]


def strength(left: Sequence[Left]) -> float:
    """Return the sum of squared z."""
    return float(sum(one.z**2 for one in left))
