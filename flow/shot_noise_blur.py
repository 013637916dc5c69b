"""How much to smooth counts before matching them, read from the counts themselves.

Where a texture of power spectrum S meets shot noise of variance N (the mean count), the most
likely shift between two frames is that of greatest correlation after a filter S/(S + N/2); over n
frames that agree, after S/(S + N/n). Both pass what is stronger than the noise. Natural textures
have edges, so S falls about as f⁻³ from a height that the excess of the counts' variance over
their mean measures. With

    q = (variance − mean)/mean          (index of dispersion − 1: texture over shot noise)

S/N goes as q·f⁻³, the cutoff as (n·q)^(1/3), and the width of the filter in pixels as its inverse.
Its shape hardly matters, so it is a Gaussian. Its constant was fitted on dead leaves and on one
photographed forest at 10⁴ to 10⁶ photons per frame of 240 × 240 px; the best width is so broad an
optimum that a step of √2 changes errors by a few percent.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from megalopta.flow.blocks import BlockGrid
from megalopta.flow.detector import FloatArray, Frames

BLURS_PX = (0.7, 1.0, 1.4, 2.0)
"""Standard deviations to choose from. Less than 0.7 px leaves too little to interpolate between
pixels, more than 2 px reaches far out of a block."""

_BLUR_AT_EQUALITY_PX = 0.6
"""Best standard deviation for two frames with as much texture as shot noise, q = 1."""

_FAINTEST = 1e-6
"""Smaller q are raised to this: no texture was seen, the largest blur is right."""


class SmoothedFrame:
    """A frame of counts, smoothed on demand."""

    def __init__(self, counts: Frames) -> None:
        self.counts = counts.astype(np.float32)
        self._roots: dict[int, NDArray[np.float32]] = {}

    def roots(self, level: int) -> NDArray[np.float32]:
        """Return the roots of the counts smoothed by `BLURS_PX[level]`, (H, W)."""
        if level not in self._roots:
            smooth = gaussian_filter(self.counts, BLURS_PX[level], mode="reflect", truncate=3.0)
            self._roots[level] = np.sqrt(smooth)
        return self._roots[level]


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
    wanted = _BLUR_AT_EQUALITY_PX * (np.maximum(excess, _FAINTEST) * frames / 2) ** (-1 / 3)
    steps = np.log(wanted)[..., np.newaxis] - np.log(BLURS_PX)
    return np.asarray(np.abs(steps).argmin(axis=-1))


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
