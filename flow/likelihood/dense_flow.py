"""Poisson flow: the flow of whole frames that is most likely, given their counts.

**Cost.** Roots of the counts, smoothed and aligned by a motion, differ from their mean by noise
alone: the sum of squares is the log-likelihood of that motion. The gradient is that of the mean of
the aligned frames: its noise is independent of noise in their differences, and biases no velocity
toward 0. Where aligned frames differ by more, evidence has proportionally less weight.

**Prior.** Links between nodes 4 px apart penalize the change of flow: proportional to the change
when small, to its logarithm when large.

**Search.** From the coarsest scale to the finest. Newton steps follow the likelihood uphill. What
moves by more than its texture is wide lies beyond their reach: at the finest scales, whole
displacements that are likelier replace the flow first. Those to where the flow so far explains the
second frame cost more.

**Solve.** Each step, with a new warp, solves a sparse symmetric system of two unknowns a node by
conjugate gradients from the flow so far (`solver`).

**Covariance.** The blocks on the diagonal of the inverse of information plus prior (Laplace's
approximation). A row of nodes is linked to the rows beside it alone, so these follow exactly from
two passes, one down and one up (Takahashi's equations).

Equations, sources and limits: `docs/theory/whole-frame-flow.md`.
"""

import math
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from megalopta.core.arrays import Floats, Mask
from megalopta.flow.likelihood import messages, roots, solver
from megalopta.flow.likelihood.roots import MOST_NOISE, NODE_PX, Level

_AGREEMENT_PX = 2.0
"""Standard deviation of the neighborhood in which aligned frames are compared"""

_STEADY, _LARGE = 0.003, 1.0
"""Changes of velocity per pixel, 1/frame: below the first the prior is quadratic, above the second
it grows as a logarithm"""
_FEW_PHOTONS, _SMOOTHNESS_POWER = 20.0, 0.3
"""Photons per pixel in all frames; fitted to dead leaves and forests, with the smoothness of
`PoissonFlow`: with fewer, full smoothness loses small moving objects. At the finest scale the prior
grows on with more, fitted to the tuning scenes of the benchmark: the likelihood is too sure, as
interpolation and edges leave more error than photons do. Coarser scales keep moving parts apart."""
_MANY_PHOTONS = 20_000.0
"""Photons per pixel in all frames above which the prior stays as it is: what frames differ by is no
longer shot noise, so the evidence does not grow"""
_NARROWER, _DIM_PHOTONS = 12.0, 60.0
"""Factor of the prior in the covariance in bright light, as most motions are smoother than the
prior allows; and photons per pixel in all frames below which it falls. Between the factors for slow
and fast tuning scenes of the benchmark; in dim light larger, for smooth motion"""

_MOST_BINS = 4
"""Pixels along a side of the coarsest bins at which large motion is sought"""
_REACH_PX = 8
"""Largest displacement along x and y, px of a level"""
_LEAVING = 0.25
"""Cost per frame but one of any other displacement than that of the flow so far, which coarser
scales and all frames have voted for; fitted as the costs in `messages`"""
_CLAIM = 1.0
"""Cost of a displacement to a place of the second frame that the flow so far explains: what is
hidden in one frame resembles something in the other by chance"""
_DARK = 1e-9
"""Least mean root of a frame, for a defined result"""

_FIRST_STEPS, _NEWTON_STEPS, _PRIOR_STEPS = 30, 3, 2
"""Newton steps at the coarsest scale, which start from no motion and are cheap, and at others"""
_LONGEST_STEP_PX, _STILL_PX = 1.0, 1e-4
"""Longest change of a step, and the one below which steps end, px of a level"""
_LEAST = 1e-9
"""Evidence for the velocity 0 at every node, for a defined result without photons"""
_INEXACT = 3e-7
"""Negative log-likelihood per node above the least at which a system counts as solved"""

Links = tuple[Floats, Floats]
"""Weights of the links of nodes to the right, (n, m − 1), and downward, (n − 1, m)"""


def likelihood_flow(counts: NDArray[Any], smoothness: float) -> Floats:
    """Return the flow (H, W, 2), px per frame, of the frame before the middle.

    `counts` (n, H, W): frames of one steady motion, two or more; `smoothness`: penalty in
    log-likelihood per pixel and unit of the flow's gradient, of 20 photons per pixel in all frames.
    NaN if a frame has no photon.
    """
    if roots.has_dark_frame(counts):
        return np.full((*counts.shape[1:], 2), np.nan)
    flow, _ = _most_likely_flow(counts, smoothness)
    return _at_pixels(flow, counts)


def flow_and_covariance(counts: NDArray[Any], smoothness: float) -> tuple[Floats, Floats]:
    """Return the flow as `likelihood_flow`, and its covariances (H, W, 2, 2), px² per frame².

    The inverse of the information of evidence and prior at nodes, interpolated; the prior's is
    multiplied by a factor that depends on the light. Where frames do not agree, as where something
    is hidden, evidence is reduced and the covariance large. NaN as `likelihood_flow`.
    """
    if roots.has_dark_frame(counts):
        return likelihood_flow(counts, smoothness), np.full((*counts.shape[1:], 2, 2), np.nan)
    flow, level = _most_likely_flow(counts, smoothness)
    times = times_from_reference(len(counts))
    aligned = evidence(level, times[np.newaxis], place_of_pixels(level, times, flow))
    narrower = _NARROWER / (1 + _DIM_PHOTONS / counts.sum(axis=0).mean())
    weights = _links(flow, narrower * smoothness_of(counts, smoothness))
    information = to_nodes(aligned.products[0] * aligned.information)
    covariance = _at_pixels(node_covariance(information, weights), counts)
    return _at_pixels(flow, counts), covariance[..., [[0, 1], [1, 2]]]


def refined_flow(counts: NDArray[Any], flow: Floats, smoothness: float) -> Floats:
    """Return a flow (H, W, 2) after one Newton step on frames (n, H, W) binned by 2 × 2 px.

    Sides have four pixels or more. Smoothness as in `likelihood_flow`, without its growth in bright
    light; NaN if a frame has no photon.
    """
    if roots.has_dark_frame(counts):
        return np.full_like(flow, np.nan)
    bins = 2
    level = roots.level_of(roots.halved(counts.astype(np.float64)), bins)
    sums = to_nodes(roots.halved(np.moveaxis(flow, -1, 0)))
    pixels = bins**2 * to_nodes(np.ones((1, *level.roots.shape[1:])))
    times, weight = times_from_reference(len(counts)), bins * smoothness_of(counts, smoothness)
    better = _newton(level, times, sums / (bins * pixels), weight, steps=1)
    return bins * np.moveaxis(finer(better, counts.shape[1:], bins * NODE_PX), 0, -1)


def _most_likely_flow(counts: NDArray[Any], smoothness: float) -> tuple[Floats, Level]:
    """Return the flow at nodes, (2, n, m), and the finest level."""
    times = times_from_reference(len(counts))
    flow = np.zeros((2, 1, 1))
    for number, level in enumerate(roots.pyramid(roots.without_defects(counts))):
        nodes = tuple(-(-side // NODE_PX) for side in level.roots.shape[1:])
        flow = 2 * finer(flow, nodes, 2)
        most = 1.0 if level.bins > 1 else math.inf
        weight = level.bins * smoothness_of(counts, smoothness, most)
        steps = _NEWTON_STEPS if number else _FIRST_STEPS
        if level.bins <= _MOST_BINS:
            if number == 0:  # whole displacements compete with the best flow near no motion
                flow = _newton(level, times, flow, weight, steps)
            flow = with_large_motion(level, times, flow)
        flow = _newton(level, times, flow, weight, steps)
    return flow, level


def _newton(level: Level, times: Floats, flow: Floats, smoothness: float, steps: int) -> Floats:
    """Return a flow at nodes, (2, n, m), after steps toward the most likely one."""
    for _ in range(steps):
        aligned = evidence(level, times[np.newaxis], place_of_pixels(level, times, flow))
        xx, xy, yy = information = to_nodes(aligned.products[0] * aligned.information)
        x, y = flow
        target = to_nodes(aligned.slope[0]) + np.stack((xx * x + xy * y, xy * x + yy * y))
        best = flow
        for _ in range(_PRIOR_STEPS):
            best = most_likely(information, target, _links(best, smoothness), best)
        change = np.clip(best - flow, -_LONGEST_STEP_PX, _LONGEST_STEP_PX)
        flow = flow + change
        if np.abs(change).max() < _STILL_PX:
            break
    return flow


# Cost


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
    weight = 4 * inside / np.maximum(1, around / MOST_NOISE)
    drift = -weight * np.tensordot(spread, differences, 1)
    right, down = gradient
    return Evidence(
        weight * np.stack((right * right, right * down, down * down)),
        spread @ spread.T,
        drift[:, np.newaxis] * gradient,
        float(roots.misfit(around)[inside].mean()) if inside.any() else np.inf,
    )


def aligned_frames(level: Level, places: Iterable[Floats]) -> tuple[Floats, Mask]:
    """Return the roots of frames (n, H, W) at places, and which places are in all frames.

    Brightness that differs from frame to frame by a factor is equalized.
    """
    inside = np.ones(level.roots.shape[1:], np.bool_)
    aligned = np.empty_like(level.roots)
    for frame, splines, moved in zip(aligned, level.splines, places, strict=True):
        roots.interpolate(splines, moved, frame, inside)
    mean = aligned.mean(axis=0) * inside
    power, shared = (mean**2).sum(), (aligned * mean).sum(axis=(1, 2))
    aligned *= np.divide(power, shared, out=np.ones_like(shared), where=shared > 0)[:, None, None]
    return aligned, inside


def times_from_reference(frames: int) -> Floats:
    """Return the times of frames relative to the one before the middle, (frames,)."""
    return np.arange(frames, dtype=np.float64) - (frames // 2 - 1)


def place_of_pixels(level: Level, times: Floats, flow: Floats) -> Iterator[Floats]:
    """Yield the places (2, H, W) at each time of the content of pixels, given a flow at nodes."""
    shape = level.roots.shape[1:]
    pixels = np.mgrid[: shape[0], : shape[1]].astype(np.float64)
    motion = finer(flow, shape, NODE_PX)[::-1]
    return (pixels + time * motion for time in times)


def finer(coarse: Floats, shape: tuple[int, ...], factor: int) -> Floats:
    """Return values (k, n, m) on a finer grid of this shape, by linear interpolation."""
    for axis, side in enumerate(shape, start=1):
        last = coarse.shape[axis] - 1
        place = ((np.arange(side) + 0.5) / factor - 0.5).clip(0, last)
        before = place.astype(np.intp)
        share = np.expand_dims(place - before, tuple(range(axis, 2)))
        start = coarse.take(before, axis)
        coarse = start + share * (coarse.take(np.minimum(before + 1, last), axis) - start)
    return coarse


def _at_pixels(values: Floats, counts: NDArray[Any]) -> Floats:
    """Return values at nodes (k, n, m) at the pixels of frames, (H, W, k)."""
    return np.moveaxis(finer(values, counts.shape[1:], NODE_PX), 0, -1)


def to_nodes(pixels: Floats) -> Floats:
    """Return sums of (c, H, W) over the squares around nodes."""
    count, *shape = pixels.shape
    rows, columns = (-(-side // NODE_PX) for side in shape)
    missing = [(0, 0), (0, rows * NODE_PX - shape[0]), (0, columns * NODE_PX - shape[1])]
    squares = np.pad(pixels, missing).reshape(count, rows, NODE_PX, columns, NODE_PX)
    return np.asarray(squares.sum(axis=(2, 4)))


# Prior


def smoothness_of(counts: NDArray[Any], smoothness: float, most: float = 1.0) -> float:
    """Return the penalty of counts (n, H, W) per unit of the gradient of their flow.

    It grows with the photons, to `most` times the smoothness.
    """
    photons = min(counts.sum(axis=0).mean(), _MANY_PHOTONS)
    return float(smoothness * min(most, (photons / _FEW_PHOTONS) ** _SMOOTHNESS_POWER))


def link_weights(smoothness: float, squared_change: Floats) -> Floats:
    """Return the weights (n, m) of links with a squared change of flow (n, m), px²."""
    change = np.sqrt(squared_change / NODE_PX**2 + _STEADY**2)
    return np.asarray(smoothness / (change * (1 + change / _LARGE)))


def _links(flow: Floats, smoothness: float) -> Links:
    right, down = ((np.diff(flow, axis=axis) ** 2).sum(axis=0) for axis in (2, 1))
    return link_weights(smoothness, right), link_weights(smoothness, down)


# Search


def with_large_motion(level: Level, times: Floats, flow: Floats, reach: int = _REACH_PX) -> Floats:
    """Return the flow at nodes (2, n, m), px, where another displacement is likelier, that one.

    The two frames in the middle tell: in frames farther apart, a fraction of a pixel is many.
    """
    area = NODE_PX**2
    pair = np.s_[len(times) // 2 - 1 : len(times) // 2 + 1]
    middle = level._replace(roots=level.roots[pair], splines=level.splines[pair])
    aligned, inside = aligned_frames(middle, place_of_pixels(middle, times[pair], flow))
    squares = inside * (aligned[1] - aligned[0]) ** 2 / 2
    seen = np.maximum(to_nodes(inside[np.newaxis].astype(np.float64))[0], 1)
    now = to_nodes(squares[np.newaxis])[0] * area / seen
    # how well the flow so far explains the second frame around each node, 0 to 1
    *_, back = place_of_pixels(middle, np.array([0.0, -1.0]), flow)
    around = gaussian_filter(squares, _AGREEMENT_PX) / middle.noise
    at_second = map_coordinates(around, back, order=1, mode="nearest")
    explained = to_nodes(np.clip(2 - at_second, 0, 1)[np.newaxis])[0] / area
    side = 2 * reach + 1
    costs = np.empty((*now.shape, side**2 + 1), np.float32)
    brightness = middle.roots.mean(axis=(1, 2), keepdims=True)
    equal = middle.roots * (brightness.mean() / np.maximum(brightness, _DARK))
    leaving, noise = _LEAVING * (len(times) - 1), area * level.noise
    messages.fill_costs(equal.astype(np.float32), now, noise, leaving, _CLAIM * explained, costs)
    total = costs.copy()
    messages.add_messages(costs, flow, total)
    best = total.argmin(axis=-1)
    y, x = np.divmod(best, side)
    return np.where(best == side**2, flow, np.stack((x, y)) - float(reach))


# Solve


def most_likely(
    information: Floats, slope: Floats, weights: Links, start: Floats, inexact: float = _INEXACT
) -> Floats:
    """Return the velocities u, (2, n, m), that minimize ½Σuᵀ·A·u − bᵀ·u + ½Σw·|u − u'|².

    `information` (3, n, m): A of each node: xx, xy, yy; `slope` (2, n, m): b of each node;
    `weights`: w; `start` (2, n, m): velocities nearby; `inexact`: sum above the least, per node.
    """
    (xx, xy, yy), (right, down), velocities = information, weights, start.copy()
    right, down = np.pad(right, ((0, 0), (0, 1))), np.pad(down, ((0, 1), (0, 0)))
    matrix = np.stack((xx + _LEAST, xy, yy + _LEAST, right, down))
    solver.improve(matrix, slope, velocities, inexact * xx.size)
    return velocities


def links(shape: tuple[int, ...]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return both nodes of all links of a grid, (links,) each: to the right, then downward."""
    index = np.arange(int(np.prod(shape))).reshape(shape)
    first = np.concatenate((index[:, :-1].ravel(), index[:-1].ravel()))
    second = np.concatenate((index[:, 1:].ravel(), index[1:].ravel()))
    return first, second


# Covariance


def node_covariance(information: Floats, weights: Links) -> Floats:
    """Return the covariances (3, n, m) of nodes, px²: xx, xy, yy; some node has information.

    `information` (3, n, m) and weights as for `most_likely`.
    """
    right, below = weights
    if information.shape[1] < information.shape[2]:  # blocks of the shorter side
        return node_covariance(information.transpose(0, 2, 1), (below.T, right.T)).transpose(
            0, 2, 1
        )
    rows, width = information.shape[1:]
    node = np.arange(width)
    down = np.pad(np.tile(below, 2), ((1, 1), (0, 0)))  # of both components
    # inverse of each row, given all above
    above: list[Floats] = []
    for row in range(rows):
        xx, xy, yy = information[:, row]
        beside, vertical = right[row], down[row] + down[row + 1]
        pull = np.pad(beside, (1, 0)) + np.pad(beside, (0, 1))
        # the matrix of a row, x of all nodes before y
        block = np.diag(np.concatenate((xx + pull, yy + pull)) + vertical)
        block[node, node + width] = block[node + width, node] = xy
        for first in (node[:-1], node[:-1] + width):
            block[first, first + 1] = block[first + 1, first] = -beside
        if row:
            block -= down[row][:, np.newaxis] * above[-1] * down[row]
        above.append(np.asarray(np.linalg.inv(block), np.float64))
    covariance, inverse = np.empty_like(information), above[-1]
    for row in range(rows - 1, -1, -1):
        if row < rows - 1:
            linked = above[row] * down[row + 1]
            inverse = np.asarray(above[row] + linked @ inverse @ linked.T)
        diagonal = np.diag(inverse)
        covariance[:, row] = diagonal[:width], np.diag(inverse, width), diagonal[width:]
    return covariance
