"""Roots of smoothed counts, on a pyramid of scales: what the likelihood compares.

Where a texture of power spectrum S meets shot noise of variance N (the mean count), the most likely
shift of n frames is that of greatest correlation after a filter S/(S + N/n). Natural textures have
edges, so S/N goes as q·f⁻³ with q = (variance − mean)/mean, the index of dispersion less 1, and the
filter's width in pixels as (n·q)^(−1/3). It is a Gaussian, whose constant was fitted on dead leaves
and one photographed forest at 10⁴ to 10⁶ photons per frame of 240 × 240 px.

Binned by 2 × 2 px, counts remain Poisson; their roots have the same noise at any brightness
(Anscombe 1948).
"""

import math
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, spline_filter

from megalopta.core.arrays import Floats, Mask
from megalopta.core.compiling import compiled

NODE_PX = 4
"""Distance of the nodes of a motion"""
AGREEMENT_PX = 2.0
"""Standard deviation of the neighborhood in which aligned frames are compared"""
MOST_NOISE = 2.0
"""Mean squared difference of aligned frames, over that of noise, above which evidence is reduced"""

BORDER_PX = 3
"""Width of the border of splines, which repeats their edge"""

_SMALLEST_LEVEL_PX = 12
_BLURS_PX = 0.7, 2.5
"""Least and most blur"""
_STANDS_OUT = 3 * 2**0.5
"""Distance of roots of counts that shot noise alone exceeds once in 10⁹ pairs of pixels"""


class Level(NamedTuple):
    """Frames at one scale."""

    roots: Floats
    """(n, H, W), smoothed"""
    splines: Floats
    """Coefficients of their cubic splines, with a border of `BORDER_PX`"""
    noise: float
    """Variance of the roots"""
    bins: int
    """Pixels of the frames per pixel of this level, along a side"""
    dispersion: float
    """Variance of the counts over their mean, which they were divided by"""
    gain_px: float
    """Standard deviation of the neighborhood in which frames differ by one factor, px"""


def suited_blur_px(excess: Floats, frames: int) -> Floats:
    """Return the standard deviation of the best blur (px), of any shape.

    `excess`: q of the unsmoothed counts; `frames`: number of frames to align.
    """
    ratios = np.maximum(excess, 1e-6) * frames / 2  # smaller q get the widest blur too
    return np.asarray(0.6 * ratios ** (-1 / 3))  # 0.6 px at q = 1


def root_noise(smooth: Callable[[Floats], NDArray[Any]]) -> float:
    """Return the variance of roots of smoothed counts due to shot noise, at any brightness.

    A quarter of a variance equal to the mean, after smoothing.

    `smooth`: smooths (H, W); reaches 15 px at most.
    """
    impulse = np.zeros((31, 31))
    impulse[15, 15] = 1
    return float((smooth(impulse) ** 2).sum() / 4)


def has_dark_frame(counts: NDArray[Any]) -> bool:
    """Return whether one of frames (n, H, W) has no photon, so that nothing aligns it."""
    return not counts.any(axis=(1, 2)).all()


def without_defects(counts: NDArray[Any]) -> Floats:
    """Return frames (n, H, W) with the median of their surroundings at hot and dead pixels.

    Such a pixel is brighter than all but one of its eight neighbors, or darker, in every frame, by
    more than noise, and alike in all of them. What moves is so in one frame, other bright specks
    that replace it differ, and a line has two neighbors alike.
    """
    frames = counts.astype(np.float64)
    bordered = np.pad(frames, ((0, 0), (1, 1), (1, 1)), "edge")
    roots = np.sqrt(bordered.clip(0))
    down, right = (np.abs(np.diff(roots, axis=axis)) > _STANDS_OUT for axis in (1, 2))
    differs = down[:, 1:, 1:-1] | down[:, :-1, 1:-1]  # from a neighbor below or above
    differs &= right[:, 1:-1, 1:] | right[:, 1:-1, :-1]
    steady = np.ptp(roots[:, 1:-1, 1:-1], axis=0) < _STANDS_OUT
    y, x = np.nonzero(differs.all(axis=0) & steady)
    around = np.lib.stride_tricks.sliding_window_view(bordered, (3, 3), axis=(1, 2))[:, y, x]
    ordered, root = np.sort(around.reshape(len(frames), -1, 9)), roots[:, y + 1, x + 1]
    above = (root - np.sqrt(ordered[..., -3])).min(axis=0)
    below = (np.sqrt(ordered[..., 2]) - root).min(axis=0)
    defect = np.maximum(above, below) > _STANDS_OUT
    frames[:, y[defect], x[defect]] = ordered[:, defect, 4]
    return frames


def pyramid(counts: Floats) -> list[tuple[Floats, int]]:
    """Return frames (n, H, W) and pixels along a side of their bins, the coarsest first."""
    scales = [(counts, 1)]
    while min(scales[-1][0].shape[1:]) // 2 >= _SMALLEST_LEVEL_PX:
        frames, bins = scales[-1]
        scales.append((halved(frames), 2 * bins))
    return scales[::-1]


def halved(frames: Floats) -> Floats:
    """Return frames (n, H, W) binned by 2 × 2 px; an odd row or column is cut."""
    height, width = (side // 2 for side in frames.shape[1:])
    even = frames[:, : 2 * height, : 2 * width]
    return np.asarray(even.reshape(-1, height, 2, width, 2).sum(axis=(2, 4)))


def level_of(
    frames: Floats,
    bins: int = 1,
    dispersion: float = 1.0,
    gain_share: float = math.inf,
    blur_px: float | None = None,
) -> Level:
    """Return frames (n, H, W), binned by `bins`, as roots and splines; the rest as in `Level`.

    `blur_px`: default: the one suited to their texture and light.
    """
    frames = frames / dispersion
    if blur_px is None:
        excess = frames.var(axis=(1, 2)).mean() / frames.mean() - 1
        blur_px = float(suited_blur_px(excess, len(frames)).clip(*_BLURS_PX))
    smooth = partial(gaussian_filter, sigma=blur_px)
    roots = np.sqrt(np.stack([smooth(frame) for frame in frames]).clip(0))
    splines = (spline_filter(root, 3, mode="nearest") for root in roots)
    bordered = np.stack([np.pad(spline, BORDER_PX, "edge") for spline in splines])
    gain_px = max(gain_share * max(frames.shape[1:]), 6.0)  # px: smallest neighborhood
    return Level(roots, bordered, root_noise(smooth), bins, dispersion, gain_px)


@compiled(fastmath={"reassoc", "contract"})
def interpolate(splines: Floats, places: Floats, values: Floats, inside: Mask) -> None:
    """Write the values (H, W) of splines at places; make false what is `inside` no longer.

    `places` (2, H, W): row and column; `inside` (H, W): whether it is in the frame.
    """
    rows, columns = values.shape
    for i in range(rows):
        for j in range(columns):
            y, x = places[0, i, j], places[1, i, j]
            inside[i, j] &= (-0.5 < y < rows - 0.5) & (-0.5 < x < columns - 0.5)
            y = 2 + min(y, rows) if y > -1 else 1.0  # also what is not finite
            x = 2 + min(x, columns) if x > -1 else 1.0
            top, left = int(y), int(x)
            down, right = _spline_weights(y - top), _spline_weights(x - left)
            value = 0.0
            for k in range(4):
                across = 0.0
                for m in range(4):
                    across += right[m] * splines[top + k, left + m]
                value += down[k] * across
            values[i, j] = value


@compiled
def _spline_weights(after: float) -> tuple[float, float, float, float]:
    """Return the weights of the coefficients around a place, so far after the second of them."""
    left = 1 - after
    second = 2 / 3 - after**2 * (1 - after / 2)
    third = 2 / 3 - left**2 * (1 - left / 2)
    return left**3 / 6, second, third, after**3 / 6


@compiled
def misfit(squares: Any) -> Any:
    """Return squared differences over their noise, of any shape; of large ones the logarithm."""
    excess = np.maximum(1.0, squares / MOST_NOISE)
    return np.minimum(squares, MOST_NOISE) + MOST_NOISE * np.log(excess)
