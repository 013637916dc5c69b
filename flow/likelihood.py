"""The likelihood of counts in several frames, as a function of the motion of their content.

**Smoothing.** Where a texture of power spectrum S meets shot noise of variance N (the mean count),
the most likely shift of n frames that agree is that of greatest correlation after a filter
S/(S + N/n). Natural textures have edges, so S/N goes as q·f⁻³ with q = (variance − mean)/mean, the
index of dispersion less 1, and the filter's width in pixels as (n·q)^(−1/3). Its shape hardly
matters, so it is a Gaussian. Its constant was fitted on dead leaves and on one photographed forest
at 10⁴ to 10⁶ photons per frame of 240 × 240 px; a step of √2 changes errors by a few percent.

**Evidence.** Frames are binned by 2 × 2 px again and again, which keeps their counts Poisson. Roots
of the counts, smoothed and aligned by a motion, differ from their mean by noise alone: the sum of
squares is the log-likelihood of that motion. The gradient is that of the mean of the aligned
frames: noise in it is then independent of noise in their differences, and biases no velocity
toward 0. Where aligned frames differ by more, something is occluded or not modeled; evidence there
has proportionally less weight.

Equations, sources and limits: `docs/theory/whole-frame-flow.md`.
"""

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import (
    gaussian_filter,
    map_coordinates,
    median_filter,
    rank_filter,
    spline_filter,
)
from scipy.sparse import coo_array
from scipy.sparse.linalg import LinearOperator, SuperLU, cg, splu

from megalopta.core.arrays import Floats, Mask
from megalopta.core.compiling import compiled

NODE_PX = 4
"""Distance of the nodes of a motion"""

_SMALLEST_LEVEL_PX = 12
_BLURS_PX = 0.7, 2.5
"""Least and most blur"""

_AGREEMENT_PX = 2.0
"""Standard deviation of the neighborhood in which aligned frames are compared"""

_MOST_NOISE = 2.0
"""Mean squared difference of aligned frames, over that of noise, above which evidence is reduced"""

_BLUR_AT_EQUALITY_PX = 0.6
"""Best standard deviation for two frames with as much texture as shot noise, q = 1"""

_FAINTEST = 1e-6
"""Smaller q are raised to this: without visible texture, the widest blur is right."""

_STANDS_OUT = 3 * 2**0.5
"""Distance of roots of counts that shot noise alone exceeds once in 10⁹ pairs of pixels"""

_LEAST = 1e-9
"""Evidence for the velocity 0 at every node, for a defined result without photons"""


_TOLERANCE, _MOST_STEPS = 1e-6, 40
"""Relative residual at which conjugate gradients stop, and steps after which factors are cheaper"""


class Level(NamedTuple):
    """Frames at one scale."""

    roots: Floats
    """(n, H, W), smoothed"""
    splines: Floats
    """Their cubic splines"""
    noise: float
    """Variance of the roots"""
    bins: int
    """Pixels of the frames per pixel of this level, along a side"""


class Evidence(NamedTuple):
    """Evidence of aligned frames about the displacement of each pixel, to second order.

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
    if large, its logarithm, as evidence is reduced there"""


def times_from_reference(frames: int) -> Floats:
    """Return the times of frames relative to the one before the middle, (frames,)."""
    return np.arange(frames, dtype=np.float64) - (frames // 2 - 1)


def suited_blur_px(excess: Floats, frames: int) -> Floats:
    """Return the standard deviation of the best blur (px), of any shape.

    `excess`: q of the unsmoothed counts; `frames`: number of frames to align.
    """
    ratios = np.maximum(excess, _FAINTEST) * frames / 2
    return np.asarray(_BLUR_AT_EQUALITY_PX * ratios ** (-1 / 3))


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
    frames, around = counts.astype(np.float64), (1, 3, 3)
    roots = np.sqrt(frames)
    above = (roots - rank_filter(roots, -3, around)).min(axis=0)
    below = (rank_filter(roots, 2, around) - roots).min(axis=0)
    stands_out = np.maximum(above, below) > _STANDS_OUT
    stands_out &= np.ptp(roots, axis=0) < _STANDS_OUT
    if not stands_out.any():
        return frames
    return np.where(stands_out, median_filter(frames, around), frames)


def levels(counts: Floats) -> Iterator[Level]:
    """Yield frames (n, H, W) from the coarsest level to the finest."""
    binned = [counts]
    while min(binned[-1].shape[1:]) // 2 >= _SMALLEST_LEVEL_PX:
        binned.append(halved(binned[-1]))
    for power, frames in reversed(list(enumerate(binned))):
        yield level_of(frames, 2**power)


def halved(frames: Floats) -> Floats:
    """Return frames (n, H, W) binned by 2 × 2 px; an odd row or column is cut."""
    height, width = (side // 2 for side in frames.shape[1:])
    even = frames[:, : 2 * height, : 2 * width]
    return np.asarray(even.reshape(-1, height, 2, width, 2).sum(axis=(2, 4)))


def level_of(frames: Floats, bins: int = 1) -> Level:
    """Return frames (n, H, W), binned by `bins`, as roots and splines."""
    excess = frames.var(axis=(1, 2)).mean() / frames.mean() - 1
    smooth = partial(gaussian_filter, sigma=suited_blur_px(excess, len(frames)).clip(*_BLURS_PX))
    roots = np.sqrt(np.stack([smooth(frame) for frame in frames]))
    splines = np.stack([spline_filter(root, 3, mode="nearest") for root in roots])
    return Level(roots, splines, root_noise(smooth), bins)


def evidence(level: Level, patterns: Floats, places: Iterable[Floats]) -> Evidence:
    """Return the evidence of frames about the motion that aligns them.

    `patterns` (patterns, n): components of a displacement, at each frame; for a steady one the
    times from the frame of reference; `places` (2, H, W), for each frame: row and column of the
    content of the reference frame's pixels.
    """
    aligned, inside = aligned_frames(level, places)
    mean = aligned.mean(axis=0)
    differences = aligned - mean
    gradient = np.stack(np.gradient(mean)[::-1])
    spread = patterns - patterns.mean(axis=1, keepdims=True)
    noise = (patterns.shape[1] - 1) * level.noise
    around = gaussian_filter((differences**2).sum(axis=0), _AGREEMENT_PX) / noise
    weight = 4 * inside / np.maximum(1, around / _MOST_NOISE)
    drift = -weight * np.tensordot(spread, differences, 1)
    right, down = gradient
    return Evidence(
        weight * np.stack((right * right, right * down, down * down)),
        spread @ spread.T,
        drift[:, np.newaxis] * gradient,
        float(misfit(around)[inside].mean()) if inside.any() else np.inf,
    )


@compiled
def misfit(squares: Any) -> Any:
    """Return squared differences over their noise, of any shape; of large ones the logarithm."""
    excess = np.maximum(1.0, squares / _MOST_NOISE)
    return np.minimum(squares, _MOST_NOISE) + _MOST_NOISE * np.log(excess)


def aligned_frames(level: Level, places: Iterable[Floats]) -> tuple[Floats, Mask]:
    """Return the roots of frames (n, H, W) at places, and which places are in all frames.

    Brightness that differs from frame to frame by a factor is equalized.
    """
    shape = level.roots.shape[1:]
    inside = np.ones(shape, np.bool_)
    aligned = np.empty_like(level.roots)
    for frame, splines, moved in zip(aligned, level.splines, places, strict=True):
        frame[:] = map_coordinates(splines, moved, order=3, mode="nearest", prefilter=False)
        for along, side in zip(moved, shape, strict=True):
            inside &= (along > -0.5) & (along < side - 0.5)
    mean = aligned.mean(axis=0) * inside
    power, shared = (mean**2).sum(), (aligned * mean).sum(axis=(1, 2))
    aligned *= np.divide(power, shared, out=np.ones_like(shared), where=shared > 0)[:, None, None]
    return aligned, inside


def place_of_pixels(level: Level, times: Floats, nodes: Floats) -> Iterator[Floats]:
    """Yield the places (2, H, W) at each time of the content of pixels, given a flow at nodes."""
    shape = level.roots.shape[1:]
    pixels = np.mgrid[: shape[0], : shape[1]].astype(np.float64)
    flow = finer(nodes, shape, NODE_PX)[::-1]
    return (pixels + time * flow for time in times)


def finer(coarse: Floats, shape: tuple[int, ...], factor: int) -> Floats:
    """Return values (k, n, m) on a finer grid of this shape, by linear interpolation."""
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


class MostLikely:
    """Solves systems of one size that resemble each other.

    The first is solved by factors of its matrix. These then precondition conjugate gradients, which
    take some ten steps for a similar system; where that fails, new factors replace them.
    """

    def __init__(self) -> None:
        self._factors: SuperLU | None = None

    def __call__(
        self, information: Floats, slope: Floats, springs: tuple[Floats, Floats], start: Floats
    ) -> Floats:
        """Return the velocities u, (2, n, m), that minimize ½Σuᵀ·A·u − bᵀ·u + ½Σw·|u − u'|².

        `information` (3, n, m): A of each node: xx, xy, yy; `slope` (2, n, m): b of each node;
        `springs` (n, m − 1) and (n − 1, m): w to the right neighbor, and to the lower; `start`
        (2, n, m): velocities nearby.
        """
        shape, target = information.shape[1:], slope.ravel()
        nodes = int(np.prod(shape))
        first, second = links(shape)
        stiffness = np.concatenate([spring.ravel() for spring in springs])
        ends = np.concatenate((first, second))
        pull = np.bincount(ends, np.concatenate((stiffness, stiffness)), nodes) + _LEAST
        xx, xy, yy = information.reshape(3, nodes)
        x = np.arange(nodes)
        y = x + nodes
        # (row, column, value) of every entry, x of all nodes before y
        entries = [(x, x, xx + pull), (y, y, yy + pull), (x, y, xy), (y, x, xy)]
        for offset in (0, nodes):
            entries.append((first + offset, second + offset, -stiffness))
            entries.append((second + offset, first + offset, -stiffness))
        rows, columns, values = (np.concatenate(part) for part in zip(*entries, strict=True))
        matrix = coo_array((values, (rows, columns)), shape=(2 * nodes, 2 * nodes)).tocsc()
        if self._factors is not None:
            similar = LinearOperator(matrix.shape, self._factors.solve, dtype=target.dtype)
            how: dict[str, Any] = {"rtol": _TOLERANCE, "maxiter": _MOST_STEPS, "M": similar}
            found, steps = cg(matrix, target, start.ravel(), **how)
            if steps == 0:  # it has converged
                return np.asarray(found).reshape(slope.shape)
        options = {"SymmetricMode": True}
        self._factors = splu(matrix, permc_spec="MMD_AT_PLUS_A", options=options)
        return np.asarray(self._factors.solve(target)).reshape(slope.shape)


def links(shape: tuple[int, ...]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return both nodes of all links of a grid, (links,) each: to the right, then downward."""
    index = np.arange(int(np.prod(shape))).reshape(shape)
    first = np.concatenate((index[:, :-1].ravel(), index[:-1].ravel()))
    second = np.concatenate((index[:, 1:].ravel(), index[1:].ravel()))
    return first, second
