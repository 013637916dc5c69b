"""Two-sample tests: of pixels, with a false discovery rate, and of one quantity, with a margin.

One quantity has one value per block of frames, so that their scatter includes correlations within a
block. Two one-sided tests (Schuirmann 1987) show whether it differs by less than a margin: the 90 %
CI lies inside it. A scene has no dark and no uniform light, so its quantities mix those of the
device: brightness, and contrast, the slope of counts over the light that the model expects.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom, f, false_discovery_control, norm, t

from megalopta.core.arrays import Floats, Mask, mean_and_variance
from megalopta.core.quantities import short, with_error
from megalopta.sensor.calibrate.level import Level

BLOCKS = 20
_LEAST_MEAN = 2.0


class PixelTest(NamedTuple):
    """P-values of pixels, and the pixels that differ at a false discovery rate."""

    p: Floats
    """P-values of any shape; NaN where nothing is tested."""
    differs: Mask
    is_more: Mask
    """True where captured values are larger"""


def discoveries(levels: list[tuple[Floats, Mask]], rate: float) -> PixelTest:
    """Test p-values, with `is_more`, of all levels at this false discovery rate."""
    p, is_more = (np.array(maps) for maps in zip(*levels, strict=True))
    tested = np.isfinite(p)
    differs = np.zeros(p.shape, np.bool_)
    if tested.any():
        differs[tested] = false_discovery_control(p[tested].clip(0, 1)) <= rate
    return PixelTest(p, differs, is_more)


class Sample(NamedTuple):
    """Mean and variance of values, of any shape, over so many frames or blocks."""

    mean: Floats
    variance: Floats
    frames: int

    @classmethod
    def of(cls, counts: NDArray[Any]) -> "Sample":
        """Return those of counts (n, …)."""
        return cls(*mean_and_variance(counts), len(counts))


def _welch(captured: Sample, expected: Sample, error: Floats | float) -> tuple[Floats, Floats]:
    """Standard error of the difference of means, and its degrees of freedom.

    `error` is a standard error of the expected mean that more frames do not reduce.
    """
    parts = [sample.variance / sample.frames for sample in (captured, expected)]
    total = parts[0] + parts[1] + np.square(error)
    squares = parts[0] ** 2 / (captured.frames - 1) + parts[1] ** 2 / (expected.frames - 1)
    return np.sqrt(total), np.maximum(total**2 / np.maximum(squares, 1e-300), 1)


def mean_test(captured: Sample, expected: Sample, error: Floats | float = 0.0) -> Floats:
    """Return p-values (rows, columns) of equal means.

    `error` is the standard error of the expected mean, if it comes from a calibration.
    """
    sigma, freedom = _welch(captured, expected, error)
    change = captured.mean - expected.mean
    p = 2 * t.sf(np.abs(change) / np.where(sigma > 0, sigma, 1), freedom)
    first, second = (
        np.rint(sample.frames * sample.mean).clip(0) for sample in (captured, expected)
    )
    total, share = first + second, captured.frames / (captured.frames + expected.frames)
    few = (total < 200.0) & (np.asarray(error) == 0)
    # two-sided, of a binomial number: twice the smaller tail
    tails = np.minimum(binom.cdf(first, total, share), binom.sf(first - 1, total, share))
    p = np.where(few, np.minimum(2 * tails, 1), p)
    return np.where((sigma == 0) & ~few, np.where(change == 0, 1.0, 0.0), p)


def variance_test(captured: Sample, expected: Sample, error: Floats | float = 0.0) -> Floats:
    """Return p-values (rows, columns) of equal variances; NaN where counts are too few.

    `error` is the standard error of the expected mean, which Poisson's variance shares.
    """
    known, logs, squares = np.ones(captured.mean.shape, np.bool_), [], []
    for mean, variance, frames in (captured, expected):
        known &= (mean > _LEAST_MEAN) & (variance > 0)
        at_least = np.maximum(mean, _LEAST_MEAN)
        doubt = np.square(error) / at_least**2 / 2
        squares.append(2 / (frames - 1) + 1 / (frames * at_least) + doubt)
        logs.append(np.log(np.where(variance > 0, variance, 1)))
    change = logs[0] - logs[1]
    p = 2 * norm.sf(np.abs(change) / np.sqrt(squares[0] + squares[1]))
    # the logarithm of a variance of few frames is skewed
    far = known & (p < 1e-3)
    ratio = np.exp(change[far].clip(-700, 700)), 2 / squares[0][far], 2 / squares[1][far]
    p[far] = np.minimum(2 * np.minimum(f.cdf(*ratio), f.sf(*ratio)), 1)
    return np.where(known, p, np.nan)


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
        return f" of {short(self.scale)}" if self.scale > abs(self.expected) else ""

    @property
    def relative_text(self) -> str:
        """Relative difference with the half width of its 95 % CI: "2.3 ± 0.4 %"."""
        return with_error(100 * self.relative, 50 * (self.high - self.low), "%")

    def __str__(self) -> str:
        if self.base:
            half = self.scale * (self.high - self.low) / 2
            captured = with_error(self.captured, half, self.unit)
            return f"{self.name} {captured} instead of {with_error(self.expected, 0, self.unit)}"
        way = "higher" if self.relative > 0 else "lower"
        return f"{self.name} {self.relative_text.removeprefix('-')} {way}"


def difference(
    name: str, unit: str, captured: Floats, expected: Floats, margin: float,
    standard_error: float = 0.0,
) -> Difference:  # fmt: skip
    """Compare the values of blocks, (blocks,) each.

    `margin` is the negligible relative difference; `standard_error` that of the expected
    values, for example from a calibration, which further blocks do not reduce.
    """
    samples = Sample.of(captured), Sample.of(expected)
    error, freedom = (float(value) for value in _welch(*samples, standard_error))
    means = float(samples[0].mean), float(samples[1].mean)
    scale = max(abs(means[1]), 1e-300)
    change = means[0] - means[1]
    p = float(2 * t.sf(abs(change) / error, freedom)) if error > 0 else float(change == 0)
    wide, narrow = (float(t.ppf(level, freedom)) * error / scale for level in (0.975, 0.95))
    relative = change / scale
    interval = relative, relative - wide, relative + wide
    return Difference(name, *means, unit, *interval, p, abs(relative) + narrow < margin, scale)


def scene_differences(
    captured: Level,
    expected: Level,
    light_hz: Floats,
    margin: float,
    errors_hz: Floats | float = 0.0,
) -> tuple[Difference, ...]:
    """Compare brightness and contrast, frame by frame, of the same scene.

    `light_hz` (n, rows, columns): the model's detection rate of always-live pixels; `margin`:
    negligible relative difference; `errors_hz` (rows, columns) or float: standard errors of
    expected rates that come from a calibration.
    """
    good = captured.usable & expected.usable
    blocks = np.array_split(np.arange(len(light_hz)), BLOCKS)
    light = light_hz[:, good]
    errors = np.broadcast_to(errors_hz, good.shape)[good]
    standard_error = float(np.sqrt(np.square(errors).sum())) / max(errors.size, 1)

    def slope(counts: Floats, light: Floats) -> float:
        """Slope of counts over light, by least squares."""
        light = light - light.mean()
        return float((light * counts).sum() / max((light**2).sum(), 1e-300))

    def compared(name: str, unit: str, measure: Any, error: float) -> Difference:
        first, second = (
            np.array([measure(level.readings[at][:, good], light[at]) for at in blocks])
            / level.exposure_s
            for level in (captured, expected)
        )
        typical = np.full(BLOCKS, second.mean())
        return difference(name, unit, first - second + typical, typical, margin, error)

    bright = compared(
        "brightness", "counts per second", lambda counts, _: counts.mean(), standard_error
    )
    if light.std() <= 1e-6 * light.mean():
        return (bright,)
    return bright, compared("contrast", "counts per photon detected", slope, 0.0)
