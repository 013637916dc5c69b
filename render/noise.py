"""The renderer's own noise, measured by rendering a frame again with other seeds.

Two renderings of a frame that share nothing but the scene differ by noise alone. Cutting a frame's
samples in halves to compare these would cost more: multijittered sampling is better than the sum of
its parts, and a frame of two halves has 1.1 to 1.2 times the error (benchmarks/bench_sampler.py).
So a frame is one pass, and every 16th frame gets a second one, for comparison only. Where passes
are added up to a stated error, every frame is measured, from the scatter of its passes.
"""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from megalopta.arrays import Floats

Image = NDArray[np.float32]
RenderPass = Callable[[int], Image]
"""Renders the pass of a given number: radiance (H, W, B), independent of the other passes."""

MEASURED_EVERY = 16
"""Frames from one that is rendered twice to the next."""

_BLOCK_PX = 4


@dataclass(frozen=True)
class RenderNoise:
    """Monte Carlo error of one frame."""

    passes: int
    """Averaged in the frame."""
    median_relative: float
    """σ/mean of the pixels of a block of 4 × 4, median over the lit blocks (sum over bands)."""
    rms_over_mean: float
    """RMS of the noise over the mean radiance (sum over bands)."""
    mean: tuple[float, ...]
    """(B,): mean radiance of each band, W·m⁻²·sr⁻¹·nm⁻¹."""
    covariance: tuple[tuple[float, ...], ...]
    """(B, B): of the noise of a pixel between bands, mean over pixels, (W·m⁻²·sr⁻¹·nm⁻¹)²."""

    def to_json(self) -> str:
        """As text for a file's header."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> "RenderNoise":
        """From what `to_json` wrote. Raises ValueError, TypeError or KeyError for anything else."""
        values = json.loads(text)
        covariance = tuple(tuple(map(float, row)) for row in values.pop("covariance"))
        mean = tuple(map(float, values.pop("mean")))
        return cls(mean=mean, covariance=covariance, **values)


class RunningMean:
    """Mean of the passes of a frame so far and their scatter (Welford's method, float64)."""

    def __init__(self) -> None:
        self.count = 0
        self._mean: Floats = np.zeros(())
        self._squares: Floats = np.zeros(())  # of the sum over bands, per pixel
        self._products: Floats = np.zeros(())  # between bands, mean over pixels

    def add(self, image: Image) -> None:
        """Take in one pass (H, W, B)."""
        self.count += 1
        if self.count == 1:
            self._mean = image.astype(np.float64)
            self._squares = np.zeros(image.shape[:2])
            self._products = np.zeros((image.shape[2], image.shape[2]))
            return
        before = image - self._mean
        self._mean += before / self.count
        after = image - self._mean
        self._squares += before.sum(axis=-1) * after.sum(axis=-1)
        self._products += np.einsum("ijk,ijl->kl", before, after) / self._squares.size

    @property
    def mean(self) -> Image:
        """Mean of the passes (H, W, B)."""
        return self._mean.astype(np.float32)

    def noise(self, averaged: int) -> RenderNoise:
        """Noise of the mean of `averaged` passes like these, of which there must be two or more."""
        degrees = self.count - 1
        variance = self._squares / (degrees * averaged)
        total = self._mean.sum(axis=-1)
        return RenderNoise(
            passes=averaged,
            median_relative=_median_relative(variance, total, degrees),
            rms_over_mean=float(np.sqrt(variance.mean()) / max(total.mean(), 1e-300)),
            mean=tuple(self._mean.mean(axis=(0, 1)).tolist()),
            covariance=tuple(
                tuple(row) for row in (self._products / (degrees * averaged)).tolist()
            ),
        )


def _median_relative(variance: Floats, total: Floats, degrees: int) -> float:
    """Median over blocks of σ/mean, from variances estimated with some degrees of freedom.

    A variance from two passes scatters so much that the median of its root over pixels of unlike σ
    is 13 % below that of σ in a forest; neighbors have nearly the same σ, and blocks know it well.
    """
    blocks, light, pixels = (_block_sums(each) for each in (variance, total, np.ones_like(total)))
    lit = light > 0
    if not lit.any():
        return 0.0
    freedom = degrees * pixels[lit]
    # The root of an estimated variance has not σ as its median.
    estimated = blocks[lit] * pixels[lit] * freedom / chi2.median(freedom)
    return float(np.median(np.sqrt(estimated) / light[lit]))


def _block_sums(values: Floats) -> Floats:
    rows, columns = (np.arange(0, size, _BLOCK_PX) for size in values.shape)
    return np.asarray(np.add.reduceat(np.add.reduceat(values, rows, axis=0), columns, axis=1))


def render_once(render_pass: RenderPass, measured: bool) -> tuple[Image, RenderNoise | None]:
    """Pass 0, and its noise by comparison with pass 1 if it is to be measured."""
    image = render_pass(0)
    if not measured:
        return image, None
    passes = RunningMean()
    passes.add(image)
    passes.add(render_pass(1))
    return image, passes.noise(averaged=1)


def render_until(
    render_pass: RenderPass, target_error: float, most_passes: int
) -> tuple[Image, RenderNoise]:
    """Mean of as many passes as bring the median relative error to the target.

    At least two, at most `most_passes`; the result says how many, and which error they left.
    """
    passes = RunningMean()
    passes.add(render_pass(0))
    while True:
        passes.add(render_pass(passes.count))
        noise = passes.noise(averaged=passes.count)
        if noise.median_relative <= target_error or passes.count >= most_passes:
            return passes.mean, noise
