"""Error of a frame from the scatter of its passes, and what stands in all frames alike."""

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincinv

from megalopta.core.arrays import Floats, Mask
from megalopta.render.noise import Image, MeasuredPass, RegionNoise, RenderNoise
from megalopta.render.standing import Standing, pairs, slopes

_BLOCK_PX = 4
_TAIL = 0.95


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
            self._slopes = [np.zeros_like(each) for each in slopes(self._mean)]
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
        """Error of the mean of `averaged` passes like these, of which there must be two or more.

        `measured` is one of them.
        """
        everywhere = np.ones(self._mean.shape[:2], bool)
        sky = measured.sky if measured else None
        frame = _Frame(
            mean=self._mean,
            flicker=self._squares / (self.count - 1),
            slopes=[each / (self.count - 1) for each in self._slopes],
            standing=Standing.of(measured, self._mean),
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
    standing: Standing
    passes: int
    averaged: int

    def covariance(self, part: Mask) -> Floats:
        """Of the whole error between bands (B, B), mean over a part (H, W) of the pixels."""
        return self._covariance(part, self.averaged)

    def _covariance(self, part: Mask, passes: int) -> Floats:
        """That of the mean of some passes."""
        flicker = self.flicker[part].mean(axis=0) / passes
        return np.asarray(flicker + self.standing.covariance(part))

    def detail(self, part: Mask) -> Floats:
        """Covariance (B, B) of what neighbors differ by without error."""
        return neighbor_differences(self.mean, part) - self._covariance(part, self.passes)

    def region(self, part: Mask) -> RegionNoise:
        """What is told of the pixels of a part (H, W)."""
        light, squares = self.mean.sum(axis=-1), self.standing.squares(part)
        flicker = self.flicker.sum(axis=(-2, -1)) / self.averaged
        covariance = self.covariance(part)
        level, levels = max(light[part].mean(), 1e-300), self.mean[part].mean(axis=0)
        median, tail = _relative(flicker, squares, light, part, self.passes - 1)
        flickers, stands = self._gradient(part)
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

    def _gradient(self, part: Mask) -> tuple[float, float]:
        """Shares of the squared differences between neighbors that the error makes.

        First that of what flickers, then that of what stands.
        """
        flicker = still = seen = 0.0
        slope = self.standing.slope(part)
        for both, noise, light in zip(pairs(part), self.slopes, slopes(self.mean), strict=True):
            flicker += float(noise[both].sum())
            still += slope * float(both.sum())
            seen += float((light[both] ** 2).sum())
        total = seen - flicker / self.passes + flicker / self.averaged
        return (flicker / self.averaged / total, still / total) if total > 0 else (0.0, 0.0)


def neighbor_differences(pixels: Floats, part: Mask) -> Floats:
    """Half the mean product (B, B) of what neighbors in a part (H, W) differ by."""
    along = [np.diff(pixels, axis=axis)[both] for axis, both in enumerate(pairs(part))]
    differences = np.concatenate(along)
    return np.asarray(differences.T @ differences / (2 * max(len(differences), 1)))


def _relative(
    flicker: Floats, squares: Floats, light: Floats, part: Mask, degrees: int
) -> tuple[float, float]:
    """Median over blocks of σ/mean, and what 95 % of the blocks do not exceed.

    A variance from two passes scatters so much that the median of its root over pixels of unlike σ
    is 13 % below that of σ in a forest; neighbors have nearly the same σ, and blocks know it well.
    """
    masked = (np.where(part, each, 0.0) for each in (flicker, squares, light, np.ones_like(light)))
    moving, still, lights, pixels = (_block_sums(each) for each in masked)
    lit = lights > 0
    if not lit.any():
        return 0.0, 0.0
    freedom = degrees * pixels[lit]
    # The root of an estimated variance has not σ as its median.
    estimated = pixels[lit] * (
        moving[lit] * freedom / (2 * gammaincinv(freedom / 2, 0.5)) + still[lit]
    )
    relative = np.sqrt(estimated) / lights[lit]
    return float(np.median(relative)), float(np.quantile(relative, _TAIL))


def _block_sums(values: Floats) -> Floats:
    rows, columns = (np.arange(0, size, _BLOCK_PX) for size in values.shape)
    return np.asarray(np.add.reduceat(np.add.reduceat(values, rows, axis=0), columns, axis=1))


def _rows(matrix: Floats) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in matrix.tolist())
