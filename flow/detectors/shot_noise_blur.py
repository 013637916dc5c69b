"""Frames smoothed as much as their counts ask for (`likelihood.suited_blur_px`), block by block.

Edges lie between plain areas, where differences are all noise. So each pixel is weighed as well, by
the variance of the smoothed roots around it: texture over texture plus noise, no less than a fifth.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, spline_filter, uniform_filter

from megalopta.flow.detectors.base import FloatArray, Frames
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.likelihood import root_noise, suited_blur_px

BLURS_PX = (0.7, 1.0, 1.4, 2.0)
"""Standard deviations to choose from. Less than 0.7 px leaves too little to interpolate between
pixels, more than 2 px reaches far out of a block."""

_NEIGHBORHOOD_BLURS = 12
"""Side of the square in which a pixel's texture is judged, in standard deviations of the blur."""

_LEAST_WEIGHT = 0.2


class SmoothedFrame:
    """A frame of counts, smoothed on demand."""

    def __init__(self, counts: Frames) -> None:
        self._counts = counts.astype(np.float32)
        self._roots: dict[int, NDArray[np.float32]] = {}
        self._splines: dict[int, NDArray[np.float32]] = {}
        self._weights: dict[int, NDArray[np.float32]] = {}
        self._moments: dict[tuple[BlockGrid, int], FloatArray] = {}

    def moments(self, grid: BlockGrid, margin_px: int) -> FloatArray:
        """Return `block_moments` of the counts."""
        if (grid, margin_px) not in self._moments:
            self._moments[grid, margin_px] = block_moments(self._counts, grid, margin_px)
        return self._moments[grid, margin_px]

    def roots(self, level: int) -> NDArray[np.float32]:
        """Return the roots of the counts smoothed by `BLURS_PX[level]`, (H, W)."""
        if level not in self._roots:
            self._roots[level] = np.sqrt(_smooth(self._counts, level))
        return self._roots[level]

    def splines(self, level: int) -> NDArray[np.float32]:
        """Return the coefficients of cubic splines through `roots`, (H, W)."""
        if level not in self._splines:
            self._splines[level] = spline_filter(self.roots(level), 3, output=np.float32)
        return self._splines[level]

    def weights(self, level: int) -> NDArray[np.float32]:
        """Return how much texture there is around each pixel of `roots`, from 0.2 to 1, (H, W)."""
        if level not in self._weights:
            side = round(_NEIGHBORHOOD_BLURS * BLURS_PX[level]) | 1
            roots = self.roots(level)
            variance = uniform_filter((roots - uniform_filter(roots, side)) ** 2, side)
            texture = np.maximum(variance - _ROOT_NOISE[level], 0)
            share = texture / (texture + _ROOT_NOISE[level])
            self._weights[level] = np.float32(_LEAST_WEIGHT) + (1 - _LEAST_WEIGHT) * share
        return self._weights[level]


def suited_levels(
    window: Sequence[SmoothedFrame], grid: BlockGrid, margin_px: int
) -> NDArray[np.intp]:
    """Return which of `BLURS_PX` suits each block, (blocks,), judged with a margin around it."""
    moments = np.sum([frame.moments(grid, margin_px) for frame in window], axis=0)
    return blur_levels(moments, len(window)).ravel()


def block_moments(counts: NDArray[np.float32], grid: BlockGrid, margin_px: int) -> FloatArray:
    """Return sums of 1, counts and squared counts over blocks and a margin, (3, rows, columns)."""
    y = _windows(counts.shape[0], grid.top, grid.block_px, grid.rows, margin_px)
    x = _windows(counts.shape[1], grid.left, grid.block_px, grid.columns, margin_px)
    pixels = np.multiply.outer(y[1] - y[0], x[1] - x[0])
    exact = counts.astype(np.float64)
    return np.stack((pixels, *(_window_sums(each, y, x) for each in (exact, exact**2))))


def blur_levels(moments: FloatArray, frames: int) -> NDArray[np.intp]:
    """Return which of `BLURS_PX` suits each block.

    Parameters
    ----------
    moments : (3, ...)
        Sums of 1, counts and squared counts.
    frames : int
        How many frames are to agree.
    """
    pixels, total, squares = moments
    with np.errstate(invalid="ignore", divide="ignore"):
        excess = np.nan_to_num((squares - total**2 / pixels) / total - 1)
    steps = np.log(suited_blur_px(excess, frames))[..., np.newaxis] - np.log(BLURS_PX)
    return np.asarray(np.abs(steps).argmin(axis=-1))


def _smooth(counts: NDArray[Any], level: int) -> NDArray[Any]:
    return np.asarray(gaussian_filter(counts, BLURS_PX[level], mode="reflect", truncate=3.0))


_ROOT_NOISE = [
    np.float32(root_noise(partial(_smooth, level=level))) for level in range(len(BLURS_PX))
]


def _windows(length: int, start: int, size: int, number: int, margin: int) -> NDArray[np.int64]:
    """Return the first pixel of each block and its margin, and the one after the last."""
    first = start + size * np.arange(number)
    return np.clip(np.stack((first - margin, first + size + margin)), 0, length)


def _window_sums(
    image: FloatArray, rows: NDArray[np.int64], columns: NDArray[np.int64]
) -> FloatArray:
    below = np.pad(image, ((1, 0), (0, 0))).cumsum(axis=0)
    strips = below[rows[1]] - below[rows[0]]
    beside = np.pad(strips, ((0, 0), (1, 0))).cumsum(axis=1)
    return np.asarray(beside[:, columns[1]] - beside[:, columns[0]])
