"""The renderer's own error, on surfaces and on the sky apart.

Two renderings of a frame with different seeds differ by noise that flickers. Cutting a frame's
samples in halves to compare these would cost more: multijittered sampling is better than the sum of
its parts, and a frame of two halves has 1.1 to 1.2 times the error (benchmarks/bench_sampler.py).
So a frame is one pass, and every 16th frame gets a second one, for comparison only. Where passes
are added up to a stated error, every frame is measured, from the scatter of its passes.

Baked light has an error that stands on surfaces in all frames alike and moves with them. It is half
the difference of two frames from independent halves of the bake, and rides on the second pass.
"""

import json
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from megalopta.arrays import Floats, Mask

Image = NDArray[np.float32]

_BLOCK_PX = 4
_TAIL = 0.95


@dataclass(frozen=True)
class MeasuredPass:
    """A pass with what is needed to know its error."""

    radiance: Image
    """(H, W, B)"""
    standing: Image
    """(H, W, B): one draw of the error that all frames share."""
    sky: NDArray[np.float32]
    """(H, W): share of each pixel that the sky fills."""


@dataclass(frozen=True)
class RegionNoise:
    """Error of the pixels that show nothing but surfaces, or nothing but sky."""

    share: float
    """Of the image that these pixels are."""
    rms: float
    """RMS error over their mean radiance (sum over bands)."""
    median: float
    """σ/mean of the pixels of a block of 4 × 4, median over blocks (sum over bands)."""
    p95: float
    """The same, not exceeded in 95 % of the blocks."""
    bands: tuple[float, ...]
    """(B,): RMS error of each band over its mean radiance."""
    gradient: float
    """Share of the differences between neighbors, squared, that the error makes."""
    standing: float
    """Part of `rms` that is alike in all frames and moves with the surfaces."""


@dataclass(frozen=True)
class RenderNoise:
    """Error of one frame: on its surfaces where there are any, else in the whole image."""

    passes: int
    """Averaged in the frame."""
    median_relative: float
    """σ/mean of the pixels of a block of 4 × 4, median over the lit blocks (sum over bands)."""
    rms_over_mean: float
    """RMS of the error over the mean radiance (sum over bands)."""
    mean: tuple[float, ...]
    """(B,): mean radiance of each band, W·m⁻²·sr⁻¹·nm⁻¹."""
    covariance: tuple[tuple[float, ...], ...]
    """(B, B): of the error of a pixel between bands, mean over pixels, (W·m⁻²·sr⁻¹·nm⁻¹)²."""
    detail: tuple[tuple[float, ...], ...] = ()
    """(B, B): of the scene, like covariance: half the mean product of the differences between
    neighbors, less that of the error."""
    surface: RegionNoise | None = None
    """None where it is not known which pixels show surfaces, or none do."""
    sky: RegionNoise | None = None

    def to_json(self) -> str:
        """As text for a file's header."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> "RenderNoise":
        """From what `to_json` wrote. Raises ValueError, TypeError or KeyError for anything else."""
        values = json.loads(text)
        for name in ("covariance", "detail"):
            values[name] = tuple(tuple(map(float, row)) for row in values.get(name, ()))
        values["mean"] = tuple(map(float, values["mean"]))
        for name in ("surface", "sky"):
            if values.get(name):
                bands = tuple(map(float, values[name]["bands"]))
                values[name] = RegionNoise(**{**values[name], "bands": bands})
        return cls(**values)


class RunningMean:
    """Mean of the passes of a frame so far and their scatter (Welford's method, float64)."""

    def __init__(self) -> None:
        self.count = 0
        self._mean: Floats = np.zeros(())
        self._squares: Floats = np.zeros(())  # between bands, per pixel
        self._slopes: list[Floats] = []  # of the sum over bands, between neighbors

    def add(self, image: Image) -> None:
        """Take in one pass (H, W, B)."""
        self.count += 1
        if self.count == 1:
            self._mean = image.astype(np.float64)
            self._squares = np.zeros((*image.shape, image.shape[2]))
            self._slopes = [np.zeros_like(each) for each in _slopes(self._mean)]
            return
        before = image - self._mean
        self._mean += before / self.count
        after = image - self._mean
        self._squares += before[..., :, None] * after[..., None, :]
        pairs = zip(self._slopes, _slopes(before), _slopes(after), strict=True)
        self._slopes = [total + a * b for total, a, b in pairs]

    @property
    def mean(self) -> Image:
        """Mean of the passes (H, W, B)."""
        return self._mean.astype(np.float32)

    def noise(
        self,
        averaged: int,
        standing: Image | None = None,
        sky: NDArray[np.float32] | None = None,
    ) -> RenderNoise:
        """Error of the mean of `averaged` passes like these, of which there must be two or more.

        `standing` and `sky` are those of a `MeasuredPass`.
        """
        everywhere = np.ones(self._mean.shape[:2], bool)
        apart = np.zeros_like(self._mean) if standing is None else standing.astype(np.float64)
        frame = _Frame(
            mean=self._mean,
            flicker=self._squares / (self.count - 1),
            slopes=[each / (self.count - 1) for each in self._slopes],
            standing=apart,
            passes=self.count,
            averaged=averaged,
        )
        surfaces = everywhere if sky is None else sky <= 0
        part = surfaces if surfaces.any() else everywhere
        whole = frame.region(part)
        return RenderNoise(
            passes=averaged,
            median_relative=whole.median,
            rms_over_mean=whole.rms,
            mean=tuple(self._mean[part].mean(axis=0).tolist()),
            covariance=_rows(frame.covariance(part)),
            detail=_rows(frame.detail(part)),
            surface=whole if sky is not None and surfaces.any() else None,
            sky=frame.region(sky >= 1) if sky is not None and (sky >= 1).any() else None,
        )


@dataclass(frozen=True)
class _Frame:
    """Mean (H, W, B) of passes, of which a frame averages some, and what single passes vary by."""

    mean: Floats
    flicker: Floats  # (H, W, B, B)
    slopes: list[Floats]
    standing: Floats
    passes: int
    averaged: int

    def covariance(self, part: Mask) -> Floats:
        """Of the whole error between bands (B, B), mean over a part (H, W) of the pixels."""
        return self._covariance(part, self.averaged)

    def _covariance(self, part: Mask, passes: int) -> Floats:
        """That of the mean of some passes."""
        apart = self.standing[part]
        return np.asarray(self.flicker[part].mean(axis=0) / passes + apart.T @ apart / len(apart))

    def detail(self, part: Mask) -> Floats:
        """Covariance (B, B) of what neighbors differ by without error."""
        return neighbor_differences(self.mean, part) - self._covariance(part, self.passes)

    def region(self, part: Mask) -> RegionNoise:
        """What is told of the pixels of a part (H, W)."""
        light, apart = self.mean.sum(axis=-1), self.standing.sum(axis=-1)
        flicker = self.flicker.sum(axis=(-2, -1)) / self.averaged
        covariance = self.covariance(part)
        level, levels = max(light[part].mean(), 1e-300), self.mean[part].mean(axis=0)
        median, tail = _relative(flicker, apart, light, part, self.passes - 1)
        return RegionNoise(
            share=float(part.mean()),
            rms=float(np.sqrt(covariance.sum()) / level),
            median=median,
            p95=tail,
            bands=tuple((np.sqrt(covariance.diagonal()) / np.maximum(levels, 1e-300)).tolist()),
            gradient=self._gradient(part),
            standing=float(np.sqrt(np.mean(apart[part] ** 2)) / level),
        )

    def _gradient(self, part: Mask) -> float:
        """Share of the squared differences between neighbors that the error makes."""
        flicker = still = seen = 0.0
        slopes = self.slopes, _slopes(self.standing), _slopes(self.mean)
        for both, *each in zip(_pairs(part), *slopes, strict=True):
            flicker += float(each[0][both].sum())
            still += float((each[1][both] ** 2).sum())
            seen += float((each[2][both] ** 2).sum())
        false = flicker / self.averaged + still
        total = seen - flicker / self.passes + flicker / self.averaged
        return false / total if total > 0 else 0.0


def neighbor_differences(pixels: Floats, part: Mask) -> Floats:
    """Half the mean product (B, B) of what neighbors in a part (H, W) differ by."""
    along = [np.diff(pixels, axis=axis)[both] for axis, both in enumerate(_pairs(part))]
    differences = np.concatenate(along)
    return np.asarray(differences.T @ differences / (2 * max(len(differences), 1)))


def _slopes(pixels: Floats) -> list[Floats]:
    """Differences between neighbors in columns and in rows, of the sum over bands."""
    return [np.diff(pixels.sum(axis=-1), axis=axis) for axis in (0, 1)]


def _pairs(part: Mask) -> list[Mask]:
    """Neighbors in columns and in rows that both lie in a part."""
    return [part[1:] & part[:-1], part[:, 1:] & part[:, :-1]]


def _relative(
    flicker: Floats, apart: Floats, light: Floats, part: Mask, degrees: int
) -> tuple[float, float]:
    """Median over blocks of σ/mean, and what 95 % of the blocks do not exceed.

    A variance from two passes scatters so much that the median of its root over pixels of unlike σ
    is 13 % below that of σ in a forest; neighbors have nearly the same σ, and blocks know it well.
    """
    masked = (np.where(part, each, 0.0) for each in (flicker, apart**2, light, np.ones_like(light)))
    moving, still, lights, pixels = (_block_sums(each) for each in masked)
    lit = lights > 0
    if not lit.any():
        return 0.0, 0.0
    freedom = degrees * pixels[lit]
    # The root of an estimated variance has not σ as its median.
    estimated = pixels[lit] * (moving[lit] * freedom / chi2.median(freedom) + still[lit])
    relative = np.sqrt(estimated) / lights[lit]
    return float(np.median(relative)), float(np.quantile(relative, _TAIL))


def _block_sums(values: Floats) -> Floats:
    rows, columns = (np.arange(0, size, _BLOCK_PX) for size in values.shape)
    return np.asarray(np.add.reduceat(np.add.reduceat(values, rows, axis=0), columns, axis=1))


def _rows(matrix: Floats) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in matrix.tolist())
