"""The flow of a whole frame under which counts of several frames are most likely.

Frames are binned by 2 × 2 px again and again, which keeps their counts Poisson, and matched from
the coarsest to the finest. At each level the flow, known at nodes 4 px apart, is the least of

    Σ over pixels of 2·Σₜ (gₜ(x + sₜ·u) − mean)²  +  Σ over links of prior(|change of u| / distance)

gₜ are roots of the counts, whose noise is the same everywhere (`shift_cost`), smoothed as much as
the counts ask for (`shot_noise_blur`); the first sum is their log-likelihood for a steady motion u,
with sₜ the time from the frame of reference. So the weight of evidence against smoothness follows
from the photons themselves, but for a small correction where they are few. A place without texture,
whose Fisher information is 0, takes its velocity from its neighbors. The gradient is that of the
mean of the aligned frames: noise in it is then independent of noise in their differences, and draws
no velocity toward 0. The prior grows as the change of velocity, not its square: it allows edges.

Where aligned frames differ by more than noise, something is hidden, or not modelled; evidence there
counts less in proportion. Newton steps, warping anew each time, go on with the roots interpolated
by cubic splines.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates, spline_filter

from megalopta.flow.detectors.base import FloatArray, Frames
from megalopta.flow.detectors.node_system import most_likely

_NODE_PX = 4
_SMALLEST_LEVEL_PX = 12
_NEWTON_STEPS, _PRIOR_STEPS = 4, 2
_LONGEST_STEP_PX = 1.0
_STEADY = 0.003
"""Change of velocity per pixel below which the prior is quadratic, 1/frame"""

_FEW_PHOTONS, _CHARGE_POWER = 20.0, 0.3
"""Per pixel in all frames; fitted to dead leaves and forests, with the smoothness of `PoissonFlow`:
with fewer, full smoothness loses small things that move for themselves"""

_BLURS_PX, _BLUR_AT_EQUALITY_PX = (0.7, 2.5), 0.6
_FAINTEST = 1e-6
_AGREEMENT_PX = 2.0
"""Standard deviation of the neighborhood in which aligned frames are compared"""

_MOST_NOISE = 2.0
"""Mean squared difference of aligned frames, over that of noise, from which evidence is less"""


class _Level(NamedTuple):
    """Frames at one scale."""

    roots: FloatArray
    """(n, H, W), smoothed"""
    splines: FloatArray
    """Their cubic splines"""
    noise: float
    """Variance of the roots"""
    bins: int
    """Pixels of the frames along one of this level"""


def likelihood_flow(counts: Frames, smoothness: float) -> FloatArray:
    """Return the flow (H, W, 2), px per frame, of the frame before the middle; NaN in the dark.

    Parameters
    ----------
    counts : (n, H, W)
        Frames of one steady motion, two or more.
    smoothness : float
        Log-likelihood that a pixel's worth of flow is charged per unit of its gradient; less
        where there are few photons.
    """
    shape = (counts.shape[1], counts.shape[2])
    if not counts.any():
        return np.full((*shape, 2), np.nan)
    times = np.arange(len(counts), dtype=np.float64) - (len(counts) // 2 - 1)
    photons = counts.sum(axis=0).mean()
    charge = smoothness * min(1.0, photons / _FEW_PHOTONS) ** _CHARGE_POWER
    nodes = np.zeros((2, 1, 1))
    for level in _levels(counts.astype(np.float64)):
        here = level.roots.shape[1:]
        nodes = 2 * _finer(nodes, tuple(-(-side // _NODE_PX) for side in here), 2)
        for _ in range(_NEWTON_STEPS):
            nodes = nodes + _step(level, times, nodes, charge * level.bins**2)
    return np.moveaxis(_finer(nodes, shape, _NODE_PX), 0, -1)


def _levels(counts: FloatArray) -> Iterator[_Level]:
    """Yield the frames from the coarsest level to the finest."""
    binned = [counts]
    while min(binned[-1].shape[1:]) // 2 >= _SMALLEST_LEVEL_PX:
        height, width = (side // 2 * 2 for side in binned[-1].shape[1:])
        even = binned[-1][:, :height, :width]
        binned.append(even.reshape(-1, height // 2, 2, width // 2, 2).sum(axis=(2, 4)))
    for power, frames in reversed(list(enumerate(binned))):
        blur = _blur_px(frames)
        roots = np.sqrt(np.stack([gaussian_filter(frame, blur) for frame in frames]))
        splines = np.stack([spline_filter(root, 3, mode="nearest") for root in roots])
        yield _Level(roots, splines, _root_noise(blur), 2**power)


def _blur_px(frames: FloatArray) -> float:
    """Return how much to smooth: the less texture to noise, the more (`shot_noise_blur`)."""
    excess = frames.var(axis=(1, 2)).mean() / frames.mean() - 1
    wanted = _BLUR_AT_EQUALITY_PX * (max(excess, _FAINTEST) * len(frames) / 2) ** (-1 / 3)
    return float(np.clip(wanted, *_BLURS_PX))


def _root_noise(blur_px: float) -> float:
    """Return the variance that shot noise gives to the roots, at any brightness."""
    impulse = np.zeros((31, 31))
    impulse[15, 15] = 1
    return float((gaussian_filter(impulse, blur_px) ** 2).sum() / 4)


def _step(level: _Level, times: FloatArray, nodes: FloatArray, smoothness: float) -> FloatArray:
    """Return how far to go from a flow at nodes, (2, n, m)."""
    information, slope = (_to_nodes(each) for each in _evidence(level, times, nodes))
    xx, xy, yy = information
    x, y = nodes
    target = slope + np.stack((xx * x + xy * y, xy * x + yy * y))
    found = nodes
    for _ in range(_PRIOR_STEPS):
        found = most_likely(information, target, _springs(found, smoothness))
    return np.clip(found - nodes, -_LONGEST_STEP_PX, _LONGEST_STEP_PX)


def _evidence(level: _Level, times: FloatArray, nodes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the information (3, H, W) on the velocity of each pixel, and the slope (2, H, W)."""
    shape = level.roots.shape[1:]
    places = np.mgrid[: shape[0], : shape[1]].astype(np.float64)
    flow = _finer(nodes, shape, _NODE_PX)[::-1]
    inside = np.ones(shape, np.bool_)
    aligned = np.empty_like(level.roots)
    for frame, splines, time in zip(aligned, level.splines, times, strict=True):
        moved = places + time * flow
        frame[:] = map_coordinates(splines, moved, order=3, mode="nearest", prefilter=False)
        for along, side in zip(moved, shape, strict=True):
            inside &= (along > -0.5) & (along < side - 0.5)
    mean = aligned.mean(axis=0)
    differences = aligned - mean
    down, right = np.gradient(mean)
    spread = times - times.mean()
    weight = 4 * inside * _agreement(differences, level.noise)
    known = (spread @ spread) * weight
    drift = -weight * np.tensordot(spread, differences, 1)
    information = known * np.stack((right * right, right * down, down * down))
    return information, drift * np.stack((right, down))


def _agreement(differences: FloatArray, noise: float) -> FloatArray:
    """Return what evidence counts, 1 where aligned frames differ by noise alone, (H, W)."""
    around = gaussian_filter((differences**2).sum(axis=0), _AGREEMENT_PX)
    return np.asarray(1 / np.maximum(1, around / ((len(differences) - 1) * noise) / _MOST_NOISE))


def _springs(nodes: FloatArray, smoothness: float) -> tuple[FloatArray, FloatArray]:
    """Return the stiffness of links along x and y: that of a prior that grows as the gradient."""
    right, down = (
        smoothness
        / np.sqrt((np.diff(nodes, axis=axis) ** 2).sum(axis=0) / _NODE_PX**2 + _STEADY**2)
        for axis in (2, 1)
    )
    return right, down


def _finer(coarse: FloatArray, shape: tuple[int, ...], factor: int) -> FloatArray:
    """Return values (2, n, m) at a grid of this shape, so many times finer, linear between them."""
    along = ((np.arange(side) + 0.5) / factor - 0.5 for side in shape)
    places = np.stack(np.meshgrid(*along, indexing="ij"))
    return np.stack([map_coordinates(each, places, order=1, mode="nearest") for each in coarse])


def _to_nodes(pixels: FloatArray) -> FloatArray:
    """Return sums of (c, H, W) over the squares around nodes."""
    count, *shape = pixels.shape
    rows, columns = (-(-side // _NODE_PX) for side in shape)
    missing = [(0, 0), (0, rows * _NODE_PX - shape[0]), (0, columns * _NODE_PX - shape[1])]
    whole = np.pad(pixels, missing).reshape(count, rows, _NODE_PX, columns, _NODE_PX)
    return np.asarray(whole.sum(axis=(2, 4)))
