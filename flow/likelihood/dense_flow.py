"""Poisson flow: the flow of whole frames that is most likely, given their counts.

**Cost.** Roots of the counts, smoothed and aligned by a motion, differ from their mean by noise
alone: the sum of squares is the log-likelihood of that motion. The gradient is that of the mean of
the aligned frames: its noise is independent of noise in their differences, and biases no velocity
toward 0. Where aligned frames differ by more, evidence has proportionally less weight.

**Prior.** Links between nodes 4 px apart penalize the change of flow: proportional to the change
when small, to its logarithm when large.

**Noise.** Counts may vary by more than shot noise: mismatch of pixels, noise of rendering. At each
scale they are divided by their dispersion, so that they are as sure as Poisson counts of that
number (quasi-likelihood).

**Light.** Frames may differ in brightness by one factor, or by one that varies over the frame. What
aligns coarse scales clearly better is taken.

**Search.** Newton steps, from the coarsest scale to the finest, follow the likelihood uphill; each
solves a sparse system (`solver`). What moves by more than its texture is wide lies beyond their
reach: at all but the coarsest scales, a search (`search`) goes first. At the finest, the flow of
another method may be proposed.

Equations, sources and limits: `docs/theory/whole-frame-flow.md`.
"""

import math
from collections.abc import Iterable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from megalopta.core.arrays import Floats
from megalopta.flow.likelihood import alignment, roots, search, solver
from megalopta.flow.likelihood.roots import AGREEMENT_PX, MOST_NOISE, NODE_PX, Level

_STEADY, _LARGE = 0.003, 1.0
"""Changes of velocity per pixel, 1/frame: below the first the prior is quadratic, above the second
it grows as a logarithm"""
_FEW_PHOTONS, SMOOTHNESS_POWER = 20.0, 0.3
"""Photons per pixel in all frames; fitted to dead leaves and forests, with the smoothness of
`PoissonFlow`: with fewer, full smoothness loses small moving objects. At the finest scale the prior
grows on with more, as interpolation and edges leave more error than photons do"""
_NARROWER, _DIM_PHOTONS = 12.0, 60.0
"""Factor of the prior in the covariance in bright light, as most motions are smoother than the
prior allows; photons per pixel in all frames below which it falls. Fitted to tuning scenes"""

_MOST_BINS, _LIGHT_BINS = 16, 8
"""Pixels along a side of the coarsest bins that are searched, and of the finest at which it is
decided how the light changes"""
_GAIN_SHARE, _EVEN = 1 / 16, 0.1
"""Neighborhood in which uneven light changes by one factor, in sides of the frame; and by how much
aligned frames must differ less after that than after one factor for all"""
_STEADIEST_PERCENT, _OF_NOISE, _BLUR_PX = 25.0, 0.8, 0.7
"""Dispersion is that of the steadiest quarter of the frame, which has this share of the mean noise,
after this blur"""
_WAY_BACK_MEDIANS, _WAY_BACK_NOISE_PX = 4.0, 1.5
"""Squared distance after the way back that is put down to the noise of that: medians of the frame,
and at most this distance"""

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

Proposal = tuple[Floats, Floats]
"""Flow (2, H, W) of another method between the two frames in the middle, and back; NaN: unknown"""


def likelihood_flow(
    counts: NDArray[Any], smoothness: float, proposal: Proposal | None = None
) -> Floats:
    """Return the flow (H, W, 2), px per frame, of the frame before the middle.

    `counts` (n, H, W): frames of one steady motion, two or more; `smoothness`: penalty in
    log-likelihood per pixel and unit of the flow's gradient, of 20 photons per pixel in all frames.
    NaN if a frame has no photon.
    """
    if roots.has_dark_frame(counts):
        return np.full((*counts.shape[1:], 2), np.nan)
    flow, level = _most_likely_flow(counts, smoothness, proposal)
    return np.moveaxis(search.sharp_flow(_middle(level), flow), 0, -1)


def flow_and_covariance(
    counts: NDArray[Any], smoothness: float, proposal: Proposal
) -> tuple[Floats, Floats]:
    """Return the flow as `likelihood_flow`, and its covariances (H, W, 2, 2), px² per frame².

    The inverse of the information of evidence and prior at nodes, interpolated; the prior's is
    multiplied by a factor that depends on the light. Where frames do not agree, evidence is reduced
    and the covariance large. Added is the squared distance from the start after the flow and the
    way back of the proposal, as far as it exceeds that of most pixels: where a match is wrong, or
    something hidden; the largest one where the flow leaves the frame. NaN as `likelihood_flow`.
    """
    if roots.has_dark_frame(counts):
        return likelihood_flow(counts, smoothness), np.full((*counts.shape[1:], 2, 2), np.nan)
    flow, level = _most_likely_flow(counts, smoothness, proposal)
    aligned = _evidence_of_velocity(level, flow)
    photons = counts.sum(axis=0).mean() / level.dispersion
    narrower = _NARROWER / (1 + _DIM_PHOTONS / photons)
    weights = _links(flow, narrower * smoothness_of(photons, smoothness))
    information = alignment.to_nodes(aligned.products[0] * aligned.information)
    at_nodes = node_covariance(information, weights)
    xx, xy, yy = alignment.finer(at_nodes, counts.shape[1:], NODE_PX)
    pixels = search.sharp_flow(_middle(level), flow)
    distance = alignment.round_trip(pixels, proposal[1])
    farthest = distance[np.isfinite(distance)].max(initial=0.0)
    around = gaussian_filter(np.minimum(distance, farthest) ** 2, AGREEMENT_PX)
    noise = min(_WAY_BACK_MEDIANS * np.median(around), _WAY_BACK_NOISE_PX**2)
    added = np.maximum(0, around - noise) / 2
    covariance = np.moveaxis(np.stack((xx + added, xy, yy + added)), 0, -1)
    return np.moveaxis(pixels, 0, -1), covariance[..., [[0, 1], [1, 2]]]


def refined_flow(counts: NDArray[Any], flow: Floats, smoothness: float) -> Floats:
    """Return a flow (H, W, 2) after one Newton step on frames (n, H, W) binned by 2 × 2 px.

    Sides have four pixels or more. Smoothness as in `likelihood_flow`, without its growth in bright
    light; NaN if a frame has no photon.
    """
    if roots.has_dark_frame(counts):
        return np.full_like(flow, np.nan)
    bins = 2
    level = roots.level_of(roots.halved(counts.astype(np.float64)), bins)
    sums = alignment.to_nodes(roots.halved(np.moveaxis(flow, -1, 0)))
    pixels = bins**2 * alignment.to_nodes(np.ones((1, *level.roots.shape[1:])))
    weight = bins * smoothness_of(counts.sum(axis=0).mean(), smoothness)
    better = _newton(level, sums / (bins * pixels), weight, steps=1)
    return bins * np.moveaxis(alignment.finer(better, counts.shape[1:], bins * NODE_PX), 0, -1)


def _most_likely_flow(
    counts: NDArray[Any], smoothness: float, proposal: Proposal | None
) -> tuple[Floats, Level]:
    """Return the flow at nodes, (2, n, m), and the finest level."""
    scales = roots.pyramid(roots.without_defects(counts))
    coarse = [scale for scale in scales if scale[1] >= _LIGHT_BINS] or scales[:1]
    least = math.inf
    for gain_share in (math.inf, _GAIN_SHARE):
        start = np.zeros((2, 1, 1))
        for frames, bins in coarse:
            start, _ = _at_scale(frames, bins, start, smoothness, gain_share)
        level = roots.level_of(frames, bins, 1.0, gain_share)
        misfit = _misfit(level, start)
        if misfit < least / (1 + _EVEN) or math.isinf(gain_share):
            flow, share, least = start, gain_share, misfit
    for frames, bins in scales[len(coarse) :]:
        flow, level = _at_scale(frames, bins, flow, smoothness, share, proposal)
    return flow, level


def _at_scale(
    frames: Floats,
    bins: int,
    coarser: Floats,
    smoothness: float,
    gain_share: float,
    proposal: Proposal | None = None,
) -> tuple[Floats, Level]:
    """Return the flow at nodes of a scale, given that of the next coarser one, and its level."""
    nodes = tuple(-(-side // NODE_PX) for side in frames.shape[1:])
    flow, is_first = 2 * alignment.finer(coarser, nodes, 2), coarser.size == 2
    dispersion = 1.0 if is_first else dispersion_of(frames, flow, gain_share)
    level = roots.level_of(frames, bins, dispersion, gain_share)
    most = 1.0 if bins > 1 else math.inf
    photons = frames.sum(axis=0).mean() / bins**2 / dispersion
    weight = bins * smoothness_of(photons, smoothness, most)
    if is_first:
        flow = min(flow, _newton(level, flow, weight, _FIRST_STEPS), key=partial(_misfit, level))
    if bins == 1 and proposal is not None:
        flow = search.with_proposal(_middle(level), flow, *proposal)
    if bins <= _MOST_BINS:
        flow = search.with_large_motion(_middle(level), len(frames), flow)
    return _newton(level, flow, weight, _NEWTON_STEPS), level


def dispersion_of(frames: Floats, flow: Floats, gain_share: float) -> float:
    """Return the variance of counts (n, H, W) over their mean, 1 or more, given a flow nearby.

    That of the steadiest part of the frame: what is hidden, or moves otherwise, has more.
    """
    level = roots.level_of(frames, gain_share=gain_share, blur_px=_BLUR_PX)
    aligned, inside, _ = alignment.aligned_frames(level, alignment.place_of_pixels(level, flow))
    squares = ((aligned - aligned.mean(axis=0)) ** 2).sum(axis=0)
    around = gaussian_filter(squares, AGREEMENT_PX) / ((len(frames) - 1) * level.noise)
    if not inside.any():
        return 1.0
    return max(1.0, float(np.percentile(around[inside], _STEADIEST_PERCENT) / _OF_NOISE))


def _middle(level: Level) -> Level:
    """Return the two frames in the middle of a level."""
    pair = np.s_[len(level.roots) // 2 - 1 : len(level.roots) // 2 + 1]
    return level._replace(roots=level.roots[pair], splines=level.splines[pair])


def _misfit(level: Level, flow: Floats) -> float:
    """Return the misfit of frames aligned by a flow, which explains nothing where it leaves."""
    aligned = _evidence_of_velocity(level, flow)
    return aligned.misfit / max(aligned.seen, _LEAST)


def _newton(level: Level, flow: Floats, smoothness: float, steps: int) -> Floats:
    """Return a flow at nodes, (2, n, m), after steps toward the most likely one."""
    for _ in range(steps):
        aligned = _evidence_of_velocity(level, flow)
        xx, xy, yy = information = alignment.to_nodes(aligned.products[0] * aligned.information)
        x, y = flow
        target = alignment.to_nodes(aligned.slope[0]) + np.stack((xx * x + xy * y, xy * x + yy * y))
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
    seen: float
    """Share of the pixels that all frames see"""


def evidence(level: Level, patterns: Floats, places: Iterable[Floats]) -> Evidence:
    """Return the evidence of frames about the motion that aligns them.

    `patterns` (patterns, n): components of a displacement, at each frame; for a steady one the
    times from the frame of reference; `places` (2, H, W), for each frame: row and column of the
    content of the reference frame's pixels.
    """
    aligned, inside, _ = alignment.aligned_frames(level, places)
    mean = aligned.mean(axis=0)
    differences = aligned - mean
    gradient = np.stack(np.gradient(mean)[::-1])
    spread = patterns - patterns.mean(axis=1, keepdims=True)
    noise = (patterns.shape[1] - 1) * level.noise
    around = gaussian_filter((differences**2).sum(axis=0), AGREEMENT_PX) / noise
    weight = 4 * inside / np.maximum(1, around / MOST_NOISE)
    drift = -weight * np.tensordot(spread, differences, 1)
    right, down = gradient
    return Evidence(
        weight * np.stack((right * right, right * down, down * down)),
        spread @ spread.T,
        drift[:, np.newaxis] * gradient,
        float(roots.misfit(around)[inside].mean()) if inside.any() else np.inf,
        float(inside.mean()),
    )


def _evidence_of_velocity(level: Level, flow: Floats) -> Evidence:
    times = alignment.times_from_reference(len(level.roots))
    return evidence(level, times[np.newaxis], alignment.place_of_pixels(level, flow))


# Prior


def smoothness_of(photons: float, smoothness: float, most: float = 1.0) -> float:
    """Return the penalty per unit of the gradient of a flow, for photons per pixel in all frames.

    It grows with the photons, to `most` times the smoothness.
    """
    photons = min(photons, 20_000.0)  # above, frames differ by more than shot noise
    return float(smoothness * min(most, (photons / _FEW_PHOTONS) ** SMOOTHNESS_POWER))


def link_weights(smoothness: float, squared_change: Floats) -> Floats:
    """Return the weights (n, m) of links with a squared change of flow (n, m), px²."""
    change = np.sqrt(squared_change / NODE_PX**2 + _STEADY**2)
    return np.asarray(smoothness / (change * (1 + change / _LARGE)))


def _links(flow: Floats, smoothness: float) -> Links:
    right, down = ((np.diff(flow, axis=axis) ** 2).sum(axis=0) for axis in (2, 1))
    return link_weights(smoothness, right), link_weights(smoothness, down)


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


# Covariance


def node_covariance(information: Floats, weights: Links) -> Floats:
    """Return the covariances (3, n, m) of nodes, px²: xx, xy, yy; some node has information.

    `information` (3, n, m) and weights as for `most_likely`. The blocks on the diagonal of the
    inverse of information plus prior (Laplace's approximation). A row of nodes is linked to the
    rows beside it alone, so two passes, down and up, give them exactly (Takahashi's equations).
    """
    right, below = weights
    if information.shape[1] < information.shape[2]:  # blocks of the shorter side
        turned = node_covariance(information.swapaxes(1, 2), (below.T, right.T))
        return turned.swapaxes(1, 2)
    rows, width = information.shape[1:]
    node = np.arange(2 * width)
    down = np.pad(np.tile(below, 2), ((1, 1), (0, 0)))
    # inverse of each row, given all above
    above: list[Floats] = []
    for row in range(rows):
        xx, xy, yy = information[:, row]
        beside = np.tile(np.pad(right[row], (0, 1)), 2)  # of both components, x before y
        pull = beside + np.roll(beside, 1) + (down[row] + down[row + 1])
        block = np.diag(np.concatenate((xx, yy)) + pull)
        for values, apart in ((-beside[:-1], 1), (xy, width)):
            block[node[apart:], node[:-apart]] = block[node[:-apart], node[apart:]] = values
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
