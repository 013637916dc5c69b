"""Error of a frame, from the scatter of its passes and from the error fixed in all frames.

A frame is one pass, and every 16th frame gets a second one, for comparison only: multijittered
sampling is better than the sum of its parts, so two halves have 1.1 to 1.2 times the error.

Baked light has an error that is fixed on surfaces in all frames. Some pixels are compared with
paths from the same points; the mean of D², the squared difference, is too large by the variance of
the paths, which follows from the scatter of the groups of a pixel's paths. Where few pixels or
noisy paths make the estimate smaller than the bake's own scatter, the latter is used.
"""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from megalopta.core.arrays import Floats, Mask

Image = NDArray[np.float32]


@dataclass(frozen=True)
class MeasuredPass:
    """Pass with the data that determines its error."""

    radiance: Image
    """(H, W, B)"""
    sky: NDArray[np.float32]
    """(H, W): share of each pixel filled by the sky."""
    standing: NDArray[np.float32] | None = None
    """(H, W, 2, B): a draw of the random part of the error that all frames share, seen by two
    independent sets of samples. None without a fixed error."""
    differences: NDArray[np.float32] | None = None
    """(H, W, G, B): difference of some pixels' light from that of paths, for G independent groups
    of paths; NaN for all other pixels. None without a fixed error."""


@dataclass(frozen=True)
class RegionNoise:
    """Error of the pixels that show only surfaces, or only sky."""

    share: float
    """Share of the image that these pixels fill."""
    rms: float
    """RMS error over their mean radiance (sum over bands)."""
    median: float
    """σ/mean of the pixels of a block of 4 × 4, median over blocks (sum over bands)."""
    p95: float
    """The same at the 95th percentile of the blocks."""
    bands: tuple[float, ...]
    """(B,): RMS error of each band over its mean radiance."""
    gradient: float
    """Share of the squared differences between neighbors that is due to the error."""
    standing: float
    """Part of `rms` that is the same in all frames and moves with the surfaces."""
    standing_gradient: float = 0.0
    """Part of `gradient` that is the same in all frames."""


@dataclass(frozen=True)
class RenderNoise:
    """Error of one frame: on its surfaces if there are any, otherwise in the whole image."""

    passes: int
    """Number of passes averaged in the frame."""
    median_relative: float
    """σ/mean of the pixels of a block of 4 × 4, median over the lit blocks (sum over bands)."""
    rms_over_mean: float
    """RMS of the error over the mean radiance (sum over bands)."""
    mean: tuple[float, ...]
    """(B,): mean radiance of each band, W·m⁻²·sr⁻¹·nm⁻¹."""
    covariance: tuple[tuple[float, ...], ...]
    """(B, B): error covariance of a pixel between bands, mean over pixels, (W·m⁻²·sr⁻¹·nm⁻¹)²."""
    detail: tuple[tuple[float, ...], ...] = ()
    """(B, B): likewise of the scene: half the mean product of the differences between neighbors,
    minus that of the error."""
    surface: RegionNoise | None = None
    """None if pixels of surfaces are unknown, or there are none."""
    sky: RegionNoise | None = None

    def to_json(self) -> str:
        """Return the error as text for a file's header."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> "RenderNoise":
        """Return the error from the text of `to_json`. Raises ValueError for anything else."""
        return TypeAdapter(cls).validate_json(text)


# Fewest pixels, or pairs, that are more precise than the scatter of the bake.
_FEWEST = 8


class Standing:
    """Error of a pass that all frames share; zero without one, in an image of a shape (H, W, B)."""

    def __init__(self, measured: MeasuredPass | None, shape: tuple[int, ...]) -> None:
        height, width, bands = shape
        self.draw: Floats = np.zeros((height, width, 2, bands))
        self.differences: Floats = np.zeros((height, width, 0, bands))
        if measured is not None and measured.standing is not None:
            self.draw = measured.standing.astype(np.float64)
        if measured is not None and measured.differences is not None:
            self.differences = measured.differences.astype(np.float64)

    def covariance(self, part: Mask) -> Floats:
        """Mean square between bands (B, B) over a part (H, W) of the pixels."""
        pixels = self._compared(self.differences, part)
        scatter = _without_scatter(self.draw[part])
        if len(pixels) < _FEWEST:
            return scatter
        return max(_without_scatter(pixels), scatter, key=np.sum)

    def slope(self, part: Mask) -> float:
        """Mean squared difference between neighbors of the error, summed over bands."""
        draws, groups = [], []
        for axis, both in enumerate(pairs(part)):
            draws.append(np.diff(self.draw.sum(axis=-1, keepdims=True), axis=axis)[both])
            steps = np.diff(self.differences.sum(axis=-1, keepdims=True), axis=axis)
            groups.append(self._compared(steps, both))
        compared = np.concatenate(groups)
        scatter = float(_without_scatter(np.concatenate(draws)).sum())
        if len(compared) < _FEWEST:
            return scatter
        return max(float(_without_scatter(compared).sum()), scatter)

    def squares(self, part: Mask) -> Floats:
        """Squared error of each pixel (H, W), summed over bands, scaled to the measured mean."""
        draw = self.draw.sum(axis=-1).mean(axis=-1) ** 2
        mean = draw[part].mean()
        square = max(float(self.covariance(part).sum()), 0.0)
        return np.asarray(draw * (square / mean) if mean > 0 else np.full_like(draw, square))

    @staticmethod
    def _compared(differences: Floats, part: Mask) -> Floats:
        inside = differences[part]
        if not inside.shape[1]:
            return inside[:0]
        return np.asarray(inside[np.isfinite(inside).all(axis=(1, 2))])


def _without_scatter(groups: Floats) -> Floats:
    """Mean product (B, B) of the means of independent groups (n, G, B), without their scatter."""
    n, count, bands = groups.shape
    sums = groups.sum(axis=1)
    members = groups.reshape(n * count, bands)
    product = (sums.T @ sums - members.T @ members) / (max(n, 1) * count * (count - 1))
    scale = np.sqrt(np.maximum(product.diagonal(), 0))
    return np.asarray(np.clip(product, -np.outer(scale, scale), np.outer(scale, scale)))


def slopes(pixels: Floats) -> list[Floats]:
    """Differences between neighbors in columns and rows, of the sum over bands."""
    return [np.diff(pixels.sum(axis=-1), axis=axis) for axis in (0, 1)]


def pairs(part: Mask) -> list[Mask]:
    """Neighbors in columns and rows that are both in a part."""
    return [part[1:] & part[:-1], part[:, 1:] & part[:, :-1]]


class RunningMean:
    """Mean of a frame's passes so far and their scatter (Welford's method, float64)."""

    def __init__(self) -> None:
        self.count = 0
        self._mean: Floats = np.zeros(())
        self._squares: Floats = np.zeros(())  # between bands, per pixel
        self._slopes: list[Floats] = []  # of the sum over bands, between neighbors

    def add(self, image: Image) -> None:
        """Add one pass (H, W, B)."""
        self.count += 1
        if self.count == 1:
            self._mean = image.astype(np.float64)
            self._squares = np.zeros((*image.shape, image.shape[2]))
            self._slopes = [np.zeros_like(slope) for slope in slopes(self._mean)]
            return
        before = image - self._mean
        self._mean += before / self.count
        after = image - self._mean
        self._squares += before[..., :, None] * after[..., None, :]
        pairs = zip(self._slopes, slopes(before), slopes(after), strict=True)
        self._slopes = [total + a * b for total, a, b in pairs]

    @property
    def mean(self) -> Image:
        """Mean of the passes (H, W, B)."""
        return self._mean.astype(np.float32)

    def noise(self, averaged: int, measured: MeasuredPass | None = None) -> RenderNoise:
        """Error of the mean of `averaged` passes like these, which must be two or more.

        `measured` is one of them.
        """
        everywhere = np.ones(self._mean.shape[:2], bool)
        sky = measured.sky if measured else None
        surfaces = everywhere if sky is None else sky <= 0
        part = surfaces if surfaces.any() else everywhere
        standing = Standing(measured, self._mean.shape)
        variance = self._squares / (self.count - 1)
        shown = self._region(part, variance, standing, averaged)
        flicker, fixed = variance[part].mean(axis=0), standing.covariance(part)
        detail = neighbor_differences(self._mean, part) - (flicker / self.count + fixed)
        return RenderNoise(
            passes=averaged,
            median_relative=shown.median,
            rms_over_mean=shown.rms,
            mean=tuple(self._mean[part].mean(axis=0).tolist()),
            covariance=_rows(flicker / averaged + fixed),
            detail=_rows(detail),
            surface=shown if sky is not None and surfaces.any() else None,
            sky=self._region(sky >= 1, variance, standing, averaged)
            if sky is not None and (sky >= 1).any()
            else None,
        )

    def _region(
        self, part: Mask, variance: Floats, standing: Standing, averaged: int
    ) -> RegionNoise:
        """Error of the pixels of a part (H, W), given the variance of single passes."""
        light, squares = self._mean.sum(axis=-1), standing.squares(part)
        flicker = variance.sum(axis=(-2, -1)) / averaged
        covariance = variance[part].mean(axis=0) / averaged + standing.covariance(part)
        level, levels = max(light[part].mean(), 1e-300), self._mean[part].mean(axis=0)
        is_even, median, tail = np.indices(light.shape).sum(axis=0) % 2 == 0, 0.0, 0.0
        variances, *halves = (
            _of_blocks(flicker, light, pixels) for pixels in (part, part & is_even, part & ~is_even)
        )
        if (lit := np.isfinite(variances)).any():
            moving = _shrunk(variances[lit], np.stack(halves)[:, lit])
            relative = np.sqrt(moving + _of_blocks(squares, light, part)[lit])
            median, tail = float(np.median(relative)), float(np.quantile(relative, 0.95))
        # Shares of the squared differences between neighbors that are due to either error.
        flickering = still = seen = flickers = stands = 0.0
        slope = standing.slope(part)
        for both, noise, steps in zip(pairs(part), self._slopes, slopes(self._mean), strict=True):
            flickering += float((noise / (self.count - 1))[both].sum())
            still += slope * float(both.sum())
            seen += float((steps[both] ** 2).sum())
        total = seen - flickering / self.count + flickering / averaged
        if total > 0:
            flickers, stands = flickering / averaged / total, still / total
        return RegionNoise(
            share=float(part.mean()),
            rms=float(np.sqrt(covariance.sum()) / level),
            median=median,
            p95=tail,
            bands=tuple((np.sqrt(covariance.diagonal()) / np.maximum(levels, 1e-300)).tolist()),
            gradient=flickers + stands,
            standing=float(np.sqrt(squares[part].mean()) / level),
            standing_gradient=stands,
        )


def neighbor_differences(pixels: Floats, part: Mask) -> Floats:
    """Half the mean product (B, B) of the differences between neighbors in a part (H, W)."""
    along = [np.diff(pixels, axis=axis)[both] for axis, both in enumerate(pairs(part))]
    differences = np.concatenate(along)
    return np.asarray(differences.T @ differences / (2 * max(len(differences), 1)))


def _shrunk(variances: Floats, halves: Floats) -> Floats:
    """Estimated variances (N,) of blocks, with the spread and level that the true ones have.

    Two passes rarely meet what makes most of a block's noise, so most blocks show too little and
    some too much. What the logarithms of two halves (2, N) of a block's pixels have in common is
    the spread of the true ones, to which they are shrunk (constrained empirical Bayes: Louis 1984,
    J. Am. Stat. Assoc. 79:393). One half then chooses blocks, as the mean of many may be that of a
    few outliers, and the other gives their mean variance without bias.
    """
    noisy, both = variances > 0, (halves > 0).all(axis=0)
    if np.count_nonzero(both) < 2:
        return variances
    common = np.cov(np.log(halves[:, both]))[0, 1]
    seen = max(np.log(variances[both]).var(ddof=1), 1e-300)
    shrunk = np.zeros_like(variances)
    shrunk[noisy] = np.exp(np.sqrt(np.clip(common / seen, 0, 1)) * np.log(variances[noisy]))
    full = np.isfinite(halves).all(axis=0)
    total = unbiased = 0.0
    for first, second in (halves[:, full], halves[::-1, full]):
        chosen = first <= np.quantile(first, 0.9)  # share of the blocks that set the level
        total += float(shrunk[full][chosen].sum())
        unbiased += float(second[chosen].sum())
    return shrunk * (unbiased / total) if total else variances


def _of_blocks(squares: Floats, light: Floats, part: Mask) -> Floats:
    """Mean square of a part's pixels in each block over its squared mean light; NaN if unlit."""
    masked = (np.where(part, quantity, 0.0) for quantity in (squares, light, np.ones_like(light)))
    rows, columns = (np.arange(0, size, 4) for size in light.shape)  # blocks of 4 × 4 px
    total, lights, pixels = (
        np.add.reduceat(np.add.reduceat(values, rows, axis=0), columns, axis=1) for values in masked
    )
    unlit = np.full_like(lights, np.nan)
    return np.asarray(np.divide(total * pixels, lights**2, out=unlit, where=lights > 0))


def _rows(matrix: Floats) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in matrix.tolist())


MEASURED_EVERY = 16
"""Interval in frames between those that are rendered twice."""


def render_once(
    render_pass: Callable[[int], Image], measure_pass: Callable[[int], MeasuredPass] | None
) -> tuple[Image, RenderNoise | None]:
    """Pass 0, (H, W, B), and its error by comparison with pass 1 if it is to be measured."""
    image = render_pass(0)
    if measure_pass is None:
        return image, None
    second = measure_pass(1)
    passes = RunningMean()
    passes.add(image)
    passes.add(second.radiance)
    return image, passes.noise(1, second)


def render_until(
    render_pass: Callable[[int], Image],
    measure_pass: Callable[[int], MeasuredPass],
    target_error: float,
    most_passes: int,
) -> tuple[Image, RenderNoise]:
    """Mean (H, W, B) of enough passes for the target RMS error on surfaces, and its error.

    There are at least two and at most `most_passes`; the result states their number and error.
    """
    first = measure_pass(0)
    passes = RunningMean()
    passes.add(first.radiance)
    while True:
        passes.add(render_pass(passes.count))
        noise = passes.noise(passes.count, first)
        if noise.rms_over_mean <= target_error or passes.count >= most_passes:
            return passes.mean, noise
