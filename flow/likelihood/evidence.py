"""Frames at several scales, and what their counts tell about motion, pixel by pixel.

Frames are binned by 2 × 2 px again and again, which keeps their counts Poisson. Roots of the counts
have the same noise everywhere (`flow.detectors.shift_cost`); smoothed as much as the counts ask for
(`shot_noise`) and aligned by a motion, their squared differences from their
mean are the log-likelihood of that motion. The gradient is that of the mean of the aligned frames:
noise in it is then independent of noise in their differences, and draws no velocity toward 0.

Where aligned frames differ by more than noise, something is hidden, or not modelled; evidence there
counts less in proportion.
"""

from collections.abc import Iterable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates, spline_filter

from megalopta.core.arrays import Floats
from megalopta.flow.likelihood.shot_noise import root_noise, suited_blur_px

NODE_PX = 4
"""Distance of the nodes at which a motion is known"""

_SMALLEST_LEVEL_PX = 12
_BLURS_PX = 0.7, 2.5
"""Least and most"""

_AGREEMENT_PX = 2.0
"""Standard deviation of the neighborhood in which aligned frames are compared"""

_MOST_NOISE = 2.0
"""Mean squared difference of aligned frames, over that of noise, from which evidence is less"""


class Level(NamedTuple):
    """Frames at one scale."""

    roots: Floats
    """(n, H, W), smoothed"""
    splines: Floats
    """Their cubic splines"""
    noise: float
    """Variance of the roots"""
    bins: int
    """Pixels of the frames along one of this level"""


class Evidence(NamedTuple):
    """What aligned frames tell about the displacement of each pixel, to second order.

    The displacement of a frame is a sum of patterns in time, each with an amplitude in px.
    """

    information: Floats
    """(3, H, W): xx, xy, yy, of an amplitude whose pattern has products of 1"""
    products: Floats
    """(patterns, patterns), of the patterns about their means"""
    slope: Floats
    """(patterns, 2, H, W), along x and y: of the log-likelihood, at the motion that aligned them"""
    misfit: float
    """Mean squared difference of a pixel from the mean of its aligned frames, over that of noise;
    where it is large, its logarithm, as evidence is less there"""


def levels(counts: Floats) -> Iterator[Level]:
    """Yield frames (n, H, W) from the coarsest level to the finest."""
    binned = [counts]
    while min(binned[-1].shape[1:]) // 2 >= _SMALLEST_LEVEL_PX:
        height, width = (side // 2 * 2 for side in binned[-1].shape[1:])
        even = binned[-1][:, :height, :width]
        binned.append(even.reshape(-1, height // 2, 2, width // 2, 2).sum(axis=(2, 4)))
    for power, frames in reversed(list(enumerate(binned))):
        yield level_of(frames, 2**power)


def level_of(frames: Floats, bins: int = 1) -> Level:
    """Return frames (n, H, W) of so many bins as roots and splines."""
    excess = frames.var(axis=(1, 2)).mean() / frames.mean() - 1
    smooth = partial(gaussian_filter, sigma=suited_blur_px(excess, len(frames)).clip(*_BLURS_PX))
    roots = np.sqrt(np.stack([smooth(frame) for frame in frames]))
    splines = np.stack([spline_filter(root, 3, mode="nearest") for root in roots])
    return Level(roots, splines, root_noise(smooth), bins)


def evidence(level: Level, patterns: Floats, places: Iterable[Floats]) -> Evidence:
    """Return what frames tell about a motion by which each is aligned.

    Parameters
    ----------
    level
    patterns : (patterns, n)
        What a displacement is made of, at each frame; of a steady one the times from the frame of
        reference.
    places : (2, H, W), of each frame
        Row and column at which it shows what the frame of reference shows at a pixel.
    """
    shape = level.roots.shape[1:]
    inside = np.ones(shape, np.bool_)
    aligned = np.empty_like(level.roots)
    for frame, splines, moved in zip(aligned, level.splines, places, strict=True):
        frame[:] = map_coordinates(splines, moved, order=3, mode="nearest", prefilter=False)
        for along, side in zip(moved, shape, strict=True):
            inside &= (along > -0.5) & (along < side - 0.5)
    mean = aligned.mean(axis=0)
    differences = aligned - mean
    gradient = np.stack(np.gradient(mean)[::-1])
    spread = patterns - patterns.mean(axis=1, keepdims=True)
    noise = (patterns.shape[1] - 1) * level.noise
    around = gaussian_filter((differences**2).sum(axis=0), _AGREEMENT_PX) / noise
    excess = np.maximum(1, around / _MOST_NOISE)
    weight = 4 * inside / excess
    drift = -weight * np.tensordot(spread, differences, 1)
    right, down = gradient
    misfit = np.minimum(around, _MOST_NOISE) + _MOST_NOISE * np.log(excess)
    return Evidence(
        weight * np.stack((right * right, right * down, down * down)),
        spread @ spread.T,
        drift[:, np.newaxis] * gradient,
        float(misfit[inside].mean()) if inside.any() else np.inf,
    )


def finer(coarse: Floats, shape: tuple[int, ...], factor: int) -> Floats:
    """Return values (k, n, m) at a grid of this shape, so many times finer, linear between them."""
    along = ((np.arange(side) + 0.5) / factor - 0.5 for side in shape)
    places = np.stack(np.meshgrid(*along, indexing="ij"))
    return np.stack([map_coordinates(each, places, order=1, mode="nearest") for each in coarse])


def to_nodes(pixels: Floats) -> Floats:
    """Return sums of (c, H, W) over the squares around nodes."""
    count, *shape = pixels.shape
    rows, columns = (-(-side // NODE_PX) for side in shape)
    missing = [(0, 0), (0, rows * NODE_PX - shape[0]), (0, columns * NODE_PX - shape[1])]
    whole = np.pad(pixels, missing).reshape(count, rows, NODE_PX, columns, NODE_PX)
    return np.asarray(whole.sum(axis=(2, 4)))
