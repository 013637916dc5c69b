"""Two-sample tests: of pixels, with a false discovery rate, and of one quantity, with a margin.

**Means**: Welch's test on the counts of frames; with few counts, the exact conditional binomial
test of two Poisson means. **Variances**: the logarithm of their ratio, with the variance of two
Poisson-like samples, 2/(n − 1) + 1/(n·m) each.

**Histograms**: χ² on bins merged until each expects `_FEWEST` readings, less the part due to
different means (the trend over bins, one degree of freedom), which have their own test with their
own uncertainty. Distances, with F and G the cumulative distributions of readings:

    total variation   ½·Σ |f − g|
    Wasserstein       Σ |F − G|           mean shift of readings, in counts
    energy            (2·Σ (F − G)²)^½    counts^½; Székely and Rizzo, J. Stat. Plan. Inference 2013

All are above 0 for finite samples of one distribution; `distances_by_chance` gives by how much.

**False discovery rates**: Benjamini and Hochberg; recordings that differ in no pixel raise an alarm
at most at this rate.

**One quantity**: one value per block of frames, so that their scatter includes correlations within
a block. Welch's t test shows whether the means differ. Two one-sided tests (Schuirmann 1987) show
whether they differ by less than a margin: the 90 % CI lies inside it.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom, chi2, false_discovery_control, norm, t

from megalopta.core.arrays import Floats, Mask, mean_and_variance
from megalopta.core.compiling import compiled

_FEW_COUNTS = 200.0
_LEAST_MEAN = 2.0
_FEWEST = 12.0
_ENTRIES_AT_ONCE = 4_000_000


class PixelTest(NamedTuple):
    """P-values of pixels, and the pixels that differ at a false discovery rate."""

    p: Floats
    """P-values of any shape; NaN where nothing is tested."""
    differs: Mask


def discoveries(p: Floats, rate: float) -> PixelTest:
    """Mark the p-values, of any shape, that are discoveries at this false discovery rate."""
    tested = np.isfinite(p)
    differs = np.zeros(p.shape, np.bool_)
    if tested.any():
        differs[tested] = false_discovery_control(p[tested].clip(0, 1)) <= rate
    return PixelTest(p, differs)


class Sample(NamedTuple):
    """Mean and variance of the counts of pixels (rows, columns), over so many frames."""

    mean: Floats
    variance: Floats
    frames: int

    @classmethod
    def of(cls, counts: NDArray[Any]) -> "Sample":
        """Return those of counts (n, rows, columns)."""
        return cls(*mean_and_variance(counts), len(counts))


def mean_test(one: Sample, other: Sample, error: Floats | float = 0.0) -> Floats:
    """Return p-values (rows, columns) of equal means.

    `error` is the standard error of the second sample's expected mean, if it comes from a
    calibration.
    """
    n, k = one.frames, other.frames
    parts = [each.variance / each.frames for each in (one, other)]
    total = parts[0] + parts[1] + np.square(error)
    apart = one.mean - other.mean
    spread = np.where(total > 0, total, 1)
    freedom = spread**2 / np.maximum(parts[0] ** 2 / (n - 1) + parts[1] ** 2 / (k - 1), 1e-300)
    p = 2 * t.sf(np.abs(apart) / np.sqrt(spread), np.maximum(freedom, 1))
    first, second = (np.rint(each.frames * each.mean).clip(0) for each in (one, other))
    both, share = first + second, n / (n + k)
    few = (both < _FEW_COUNTS) & (np.asarray(error) == 0)
    # two-sided, of a binomial number: twice the smaller tail
    tails = np.minimum(binom.cdf(first, both, share), binom.sf(first - 1, both, share))
    p = np.where(few, np.minimum(2 * tails, 1), p)
    same = (total == 0) & ~few
    return np.where(same, np.where(apart == 0, 1.0, 0.0), p)


def variance_test(one: Sample, other: Sample) -> Floats:
    """Return p-values (rows, columns) of equal variances; NaN where counts are too few."""
    error = np.zeros(one.mean.shape)
    logs, known = [], np.ones(error.shape, np.bool_)
    for mean, variance, frames in (one, other):
        known &= (mean > _LEAST_MEAN) & (variance > 0)
        error += 2 / (frames - 1) + 1 / (frames * np.maximum(mean, _LEAST_MEAN))
        logs.append(np.log(np.where(variance > 0, variance, 1)))
    return np.where(known, 2 * norm.sf(np.abs(logs[0] - logs[1]) / np.sqrt(error)), np.nan)


class Distances(NamedTuple):
    """Distances between histograms of pixels, each (rows, columns)."""

    total_variation: Floats
    wasserstein: Floats
    energy: Floats


def histogram_test(one: NDArray[Any], other: NDArray[Any]) -> tuple[Floats, Distances]:
    """Return p-values of equal distributions of counts (n, rows, columns), and distances.

    Each (rows, columns); NaN where bins are too few.
    """
    shape = one.shape[1:]
    samples = [_whole(each).reshape(len(each), -1) for each in (one, other)]
    at_once = max(_ENTRIES_AT_ONCE // _values(samples), 1)
    pieces = [
        _of_pixels([each[:, first : first + at_once] for each in samples])
        for first in range(0, samples[0].shape[1], at_once)
    ]
    p, *distances = (np.concatenate(each).reshape(shape) for each in zip(*pieces, strict=True))
    return p, Distances(*distances)


def distances_by_chance(one: NDArray[Any], other: NDArray[Any]) -> Distances:
    """Return distances within one distribution: frames (n, rows, columns) of both are shuffled."""
    both = np.concatenate([_whole(one), _whole(other)])
    order = np.random.default_rng(0).permutation(len(both))
    return histogram_test(both[order[: len(one)]], both[order[len(one) :]])[1]


def _whole(counts: NDArray[Any]) -> NDArray[np.int32]:
    rounded = np.rint(counts) if counts.dtype.kind == "f" else counts
    return rounded.astype(np.int32, copy=False)


def _values(samples: list[NDArray[np.int32]]) -> int:
    return int(max(each.max() for each in samples) - min(each.min() for each in samples)) + 1


def _of_pixels(samples: list[NDArray[np.int32]]) -> tuple[Floats, Floats, Floats, Floats]:
    """P-values and three distances of pixels, of samples (n, P)."""
    least, size = min(int(each.min()) for each in samples), _values(samples)
    pixels = samples[0].shape[1]
    seen = np.zeros((2, pixels, size))
    for histograms, each in zip(seen, samples, strict=True):
        _count(each, least, histograms)
    totals = np.array([len(each) for each in samples], np.float64)
    apart = np.subtract(*(seen / totals[:, None, None]))
    cumulative = np.cumsum(apart, axis=1)
    return (
        _chi_square_p(seen, totals),
        np.abs(apart).sum(axis=1) / 2,
        np.abs(cumulative).sum(axis=1),
        np.sqrt(2 * np.square(cumulative).sum(axis=1)),
    )


@compiled
def _count(readings: NDArray[np.int32], least: int, histograms: Floats) -> None:
    """Add readings (n, P) to histograms (P, values)."""
    for frame in range(readings.shape[0]):
        for pixel in range(readings.shape[1]):
            histograms[pixel, readings[frame, pixel] - least] += 1


def _chi_square_p(seen: Floats, totals: Floats) -> Floats:
    both = seen.sum(axis=0)
    pixels, size = both.shape
    expected = both * totals.min() / totals.sum()
    most = np.maximum(expected.sum(axis=1, keepdims=True) // _FEWEST - 1, 0)
    group = np.minimum(np.cumsum(expected, axis=1) // _FEWEST, most).astype(np.int64)
    groups = int(group.max()) + 1
    key = (group + groups * np.arange(pixels)[:, None]).ravel()

    def merged(values: Floats) -> Floats:
        sums = np.bincount(key, values.ravel(), pixels * groups).astype(np.float64)
        return sums.reshape(pixels, groups)

    first, all_ = merged(seen[0]), merged(both)
    place = merged(both * np.arange(size)) / np.maximum(all_, 1)
    excess = first - all_ * totals[0] / totals.sum()
    scale = totals.prod() / totals.sum() ** 2
    squares = (excess**2 / np.maximum(all_, 1)).sum(axis=1) / scale
    centered = place - (place * all_).sum(axis=1, keepdims=True) / totals.sum()
    spread = (all_ * centered**2).sum(axis=1)
    trend = (excess * centered).sum(axis=1) ** 2 / np.where(spread > 0, spread, 1) / scale
    freedom = (all_ > 0).sum(axis=1) - 2
    p = chi2.sf(np.maximum(squares - trend, 0), np.maximum(freedom, 1))
    return np.where(freedom > 0, p, np.nan)


class Quantity(NamedTuple):
    """Name and unit of a compared quantity."""

    name: str
    unit: str = ""
    least: float = 0.0
    """Differences are relative to the expected value, or to this if larger."""


class Difference(NamedTuple):
    """Relative difference of captured and expected values of one quantity."""

    name: str
    captured: float
    expected: float
    unit: str
    relative: float
    """Captured over expected, minus 1."""
    low: float
    high: float
    """Upper bound of its 95 % CI."""
    p: float
    is_equivalent: bool
    """True if it is significantly smaller than the margin."""
    scale: float = 0.0
    """Reference of the relative difference, if not the expected value."""

    @property
    def size(self) -> float:
        """Size in either direction: the absolute logarithm of the ratio."""
        return abs(float(np.log(max(1 + self.relative, 1e-6))))

    @property
    def base(self) -> str:
        """Reference of the relative difference if it is not the expected value; otherwise empty."""
        return f" of {self.scale:.2g}" if self.scale > abs(self.expected) else ""

    def __str__(self) -> str:
        """Describe it in a phrase."""
        if self.base:
            low, high = (self.expected + self.scale * each for each in (self.low, self.high))
            values = f"{self.name} {self.captured:.2g} {self.unit} instead of {self.expected:.2g}"
            return f"{values} (95 %: {low:.2g} to {high:.2g})"
        way = "higher" if self.relative > 0 else "lower"
        size, low, high = (_percent(each) for each in (abs(self.relative), self.low, self.high))
        return f"{self.name} {size} % {way} (95 %: {low:+} to {high:+} %)"


def _percent(share: float) -> float | int:
    """Two significant digits of a share, in percent."""
    value = float(f"{100 * share:.2g}")
    return int(value) if abs(value) >= 10 or value == 0 else value


def difference(
    quantity: Quantity, captured: Floats, expected: Floats, margin: float, unsure: float = 0.0
) -> Difference:
    """Compare the values of blocks, (blocks,) each.

    `margin` is the negligible relative difference; `unsure` the standard error of the expected
    values, for example from a calibration, which further blocks do not reduce.
    """
    samples = captured, expected
    means = float(captured.mean()), float(expected.mean())
    parts = [each.var(ddof=1) / each.size for each in samples]
    error = float(np.sqrt(sum(parts) + unsure**2))
    squares = (p**2 / (each.size - 1) for p, each in zip(parts, samples, strict=True))
    freedom = max(sum(parts) ** 2 / max(sum(squares), 1e-300), 1)
    scale = max(abs(means[1]), quantity.least, 1e-300)
    apart = means[0] - means[1]
    p = float(2 * t.sf(abs(apart) / error, freedom)) if error > 0 else float(apart == 0)
    wide, narrow = (float(t.ppf(level, freedom)) * error / scale for level in (0.975, 0.95))
    relative = apart / scale
    interval = relative, relative - wide, relative + wide
    is_equivalent = abs(relative) + narrow < margin
    return Difference(quantity.name, *means, quantity.unit, *interval, p, is_equivalent, scale)
