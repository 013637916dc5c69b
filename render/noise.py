"""The renderer's own error, on surfaces and on the sky apart: what is stored of it.

Two renderings of a frame with different seeds differ by noise that flickers. Cutting a frame's
samples in halves to compare these would cost more: multijittered sampling is better than the sum of
its parts, and a frame of two halves has 1.1 to 1.2 times the error (benchmarks/bench_sampler.py).
So a frame is one pass, and every 16th frame gets a second one, for comparison only. Where passes
are added up to a stated error, every frame is measured, from the scatter of its passes.

Baked light has an error that stands on surfaces in all frames alike and moves with them. Some
pixels of the second pass are compared with paths traced from the same points: that holds all of it,
bias included (`scatter`).
"""

import json
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]


@dataclass(frozen=True)
class MeasuredPass:
    """A pass with what is needed to know its error."""

    radiance: Image
    """(H, W, B)"""
    standing: Image
    """(H, W, B): one draw of the random part of the error that all frames share."""
    sky: NDArray[np.float32]
    """(H, W): share of each pixel that the sky fills."""
    differences: NDArray[np.float32] | None = None
    """(H, W, G, B): how far the light of some pixels is from that of paths, by G independent groups
    of paths; NaN of all other pixels. None where nothing stands."""


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
    standing_gradient: float = 0.0
    """Part of `gradient` that is alike in all frames."""


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
