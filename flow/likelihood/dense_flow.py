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
import os
_LEAVING = float(os.environ.get("LV","0.5"))
"""Cost per frame but one of any other displacement than that of the flow so far, which coarser
scales and all frames have voted for; fitted as the costs in `messages`"""
_CLAIM = 1.0
"""Cost of a displacement to a place of the second frame that the flow so far explains: what is
hidden in one frame resembles something in the other by chance"""
_DARK = 1e-9
"""Least mean root of a frame, for a defined result"""
import os

EDGE=float(os.environ.get("EDGE","1"));HALF=int(os.environ.get("HALF","1"));PULL=float(os.environ.get("PULL","4"))
PROP=[int(x) for x in os.environ.get("PROP","").split(",") if x]; PSIG=float(os.environ.get("PSIG","2")); PMARG=float(os.environ.get("PMARG","1")); PUN=float(os.environ.get("PUN","1"))
CS=int(os.environ.get("CS","0"));CR=int(os.environ.get("CR","1"))
FBD=float(os.environ.get("FBD","1.5"))
_WIDE = float(os.environ.get("WIDE", ".2"))
_GAIN_SHARE = float(os.environ.get("GS", ".125"))
_EVEN = float(os.environ.get("EPS", ".1"))
_MOSTLY, _OF_NOISE = 25, 0.8
_AGREEMENT_BLUR_PX = 0.7
_ROUND_TRIP_PX = float(os.environ.get("FBT", "1.5"))

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
    nodes, level = _most_likely_flow(counts, smoothness)
    flow = finer(nodes, counts.shape[1:], NODE_PX)
    if EDGE:
        times = times_from_reference(len(counts))
        middle = np.s_[len(times) // 2 - 1 : len(times) // 2 + 1]
        pair = level._replace(roots=level.roots[middle], splines=level.splines[middle])
        _, _, gains = aligned_frames(pair, place_of_pixels(pair, times[middle], nodes))
        messages.sharpen((pair.roots * gains).astype(np.float32), level.noise, nodes, flow, EDGE, HALF, PULL)
    return np.moveaxis(flow, 0, -1)


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
    scales = roots.pyramid(roots.without_defects(counts))
    coarse = max(1, len(scales) - 2)
    proposal=None
    if PROP:
        from megalopta.flow.detectors.libraries import DenseInverseSearch
        m=len(times)//2-1
        dis=DenseInverseSearch(stretch="anscombe", blur_px=0.7); a,b=(counts[k].astype(float) for k in (m,m+1))
        proposal=np.nan_to_num(dis.dense(a,b))
        if FBD:
            returned=np.nan_to_num(dis.dense(b,a)); H,W=a.shape
            y,x=np.mgrid[:H,:W]; at=[y+proposal[...,1],x+proposal[...,0]]
            ret=np.stack([map_coordinates(returned[...,k],at,order=1,mode="constant",cval=1e3) for k in (0,1)],-1)
            ok=np.abs(proposal+ret).max(-1)<FBD
            proposal=np.concatenate((proposal,ok[...,None].astype(float)),-1)
    # light changes by one factor, or by one that varies over the frame: what aligns frames better
    even, uneven = (
        _from_coarse(scales[:coarse], times, smoothness, share) for share in (math.inf, _GAIN_SHARE)
    )
    if os.environ.get("SAYG"): print("RATIO %.3f" % (uneven[1]/even[1]), flush=True)
    is_even = even[1] <= (1 + _EVEN) * uneven[1]
    flow, share = (even[0], math.inf) if is_even else (uneven[0], _GAIN_SHARE)
    for number, (frames, bins) in enumerate(scales[coarse - 1 :]):
        if number:
            flow = _at_next(flow, frames)
        level = _level(frames, bins, times, flow, share)
        wide = 0 if number else round(_WIDE * max(frames.shape[1:]))
        if bins in PROP and proposal is not None: flow = _fused(level, times, flow, proposal)
        flow = with_large_motion(level, times, flow, max(_REACH_PX, wide))
        flow = _newton(level, times, flow, _weight(level, counts, smoothness), _NEWTON_STEPS)
    return flow, level


def _fused(level, times, flow, proposal):
    shape=flow.shape[1:]
    px=np.moveaxis(proposal,-1,0)
    for _ in range(int(math.log2(level.bins))): px=roots.halved(px)/4
    px=px/level.bins
    n=np.maximum(to_nodes(np.ones((1,*px.shape[1:]))),1)
    other=to_nodes(px)/n
    sure=True
    if len(other)>2: sure=np.pad(other[2]*level.bins>.5,((0,shape[0]-other.shape[1]),(0,shape[1]-other.shape[2])),"edge"); other=other[:2]
    other=np.pad(other,((0,0),(0,shape[0]-other.shape[1]),(0,shape[1]-other.shape[2])),"edge")
    costs=[]
    middle = np.s_[len(times) // 2 - 1 : len(times) // 2 + 1]
    pair = level._replace(roots=level.roots[middle], splines=level.splines[middle])
    for u in (flow,other):
        a,inside,_=aligned_frames(pair, place_of_pixels(pair,times[middle],u))
        sq=(a[1]-a[0])**2/2
        c=np.where(inside,roots.misfit(gaussian_filter(sq,1.)/level.noise),2.0*PUN)
        costs.append(to_nodes(c[None])[0])
    gain=gaussian_filter(costs[0]-costs[1],PSIG)
    return np.where((gain>PMARG)&sure,other,flow)

def _from_coarse(
    scales: list[tuple[Floats, int]], times: Floats, smoothness: float, gain_share: float
) -> tuple[Floats, float]:
    """Return the flow at nodes of the last of these scales, and how far it misfits there."""
    flow = np.zeros((2, 1, 1))
    for number, (frames, bins) in enumerate(scales):
        flow = _at_next(flow, frames)
        level = (
            _level(frames, bins, times, flow, gain_share)
            if number
            else roots.level_of(frames, bins, 1.0, gain_share)
        )
        steps = _NEWTON_STEPS if number else _FIRST_STEPS
        flow = _newton(level, times, flow, _weight(level, frames, smoothness), steps)
        if CS and bins <= CS and number < len(scales)-1:
            flow = with_large_motion(level, times, flow, max(_REACH_PX if CR else 0, round(_WIDE * max(frames.shape[1:]))))
            flow = _newton(level, times, flow, _weight(level, frames, smoothness), _NEWTON_STEPS)
    level = roots.level_of(frames, bins, 1.0, gain_share)
    places = place_of_pixels(level, times, flow)
    return flow, evidence(level, times[np.newaxis], places).misfit


def _at_next(flow: Floats, frames: Floats) -> Floats:
    nodes = tuple(-(-side // NODE_PX) for side in frames.shape[1:])
    return 2 * finer(flow, nodes, 2)


def _weight(level: Level, counts: NDArray[Any], smoothness: float) -> float:
    """Return the smoothness at a level."""
    most = 1.0 if level.bins > 1 else math.inf
    return level.bins * smoothness_of(counts, smoothness, most, level.dispersion)


def _level(frames: Floats, bins: int, times: Floats, flow: Floats, gain_share: float) -> Level:
    """Return a level, its counts divided by their dispersion, given a flow nearby.

    The dispersion is that of most of the frame: what is hidden, or moves otherwise, has more.
    """
    level = roots.blurred(frames, _AGREEMENT_BLUR_PX, bins, 1.0, gain_share)
    aligned, inside = aligned_frames(level, place_of_pixels(level, times, flow))[:2]
    squares = ((aligned - aligned.mean(axis=0)) ** 2).sum(axis=0)
    around = gaussian_filter(squares, _AGREEMENT_PX) / ((len(times) - 1) * level.noise)
    least = np.percentile(around[inside], _MOSTLY) / _OF_NOISE if inside.any() else 1.0
    return roots.level_of(frames, bins, max(1.0, float(least)), gain_share)


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
    aligned, inside, _ = aligned_frames(level, places)
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


def aligned_frames(level: Level, places: Iterable[Floats]) -> tuple[Floats, Mask, Floats]:
    """Return the roots of frames (n, H, W) at places, which places are in all frames, and gains.

    Brightness that differs from frame to frame by a factor is equalized, by these gains: (n, 1, 1),
    or (n, H, W) if the factor varies over the frame.
    """
    shape = level.roots.shape[1:]
    inside = np.ones(shape, np.bool_)
    aligned = np.empty_like(level.roots)
    for frame, splines, moved in zip(aligned, level.splines, places, strict=True):
        roots.interpolate(splines, moved, frame, inside)
    mean = aligned.mean(axis=0) * inside
    power, shared = mean**2, aligned * mean
    if math.isinf(level.gain_px):
        around = power.sum(), shared.sum(axis=(1, 2), keepdims=True)
    else:  # on nodes, as fine as the gains need
        near = 0, *(level.gain_px / NODE_PX,) * 2
        around = [
            finer(
                gaussian_filter(to_nodes(values), near, mode="nearest", truncate=3.0),
                shape,
                NODE_PX,
            )
            for values in (power[np.newaxis], shared)
        ]
    gains = np.divide(*around, out=np.ones_like(around[1]), where=around[1] > _DARK)
    aligned *= gains
    return aligned, inside, gains


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


def smoothness_of(
    counts: NDArray[Any], smoothness: float, most: float = 1.0, dispersion: float = 1.0
) -> float:
    """Return the penalty of counts (n, H, W) per unit of the gradient of their flow.

    It grows with the photons, to `most` times the smoothness.
    """
    photons = min(counts.sum(axis=0).mean() / dispersion, _MANY_PHOTONS)
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

    The two frames in the middle tell: in frames farther apart, a fraction of a pixel is many. A
    displacement counts if the one found from the second frame to the first agrees. Then nodes take
    the motion of others nearby where that is likelier.
    """
    middle = np.s_[len(times) // 2 - 1 : len(times) // 2 + 1]
    pair = level._replace(roots=level.roots[middle], splines=level.splines[middle])
    back = pair._replace(roots=pair.roots[::-1], splines=pair.splines[::-1])
    leaving = _LEAVING * (len(times) - 1)
    displaced, equal = _displaced(pair, flow, reach, leaving)
    returned, _ = _displaced(back, -flow, reach, leaving)
    agrees = _round_trip(displaced, returned) < _ROUND_TRIP_PX
    flow = np.where(agrees, displaced, flow)
    messages.spread(equal, level.noise, flow)
    return flow


def _round_trip(there: Floats, back: Floats) -> Floats:
    """Return how far from a node its flow (2, n, m) and that of the second frame lead, px."""
    shape = there.shape[1:]
    nodes = np.mgrid[: shape[0], : shape[1]] + there[::-1] / NODE_PX
    nearest = np.rint(nodes).astype(np.intp)
    y, x = (place.clip(0, side - 1) for place, side in zip(nearest, shape, strict=True))
    returned = np.pad(back, ((0, 0), (1, 1), (1, 1)), "edge")
    around = ((y + down, x + right) for down in range(3) for right in range(3))
    lengths = np.stack(
        [np.abs(there + returned[:, row, column]).max(axis=0) for row, column in around]
    ).min(axis=0)
    inside = (nearest[0] == y) & (nearest[1] == x)
    return np.where(inside, lengths, np.inf)


def _displaced(
    pair: Level, flow: Floats, reach: int, leaving: float
) -> tuple[Floats, messages.Singles]:
    """Return the flow with whole displacements up to a reach, and equally bright roots (2, H, W)."""
    area = NODE_PX**2
    there = np.array([0.0, 1.0])
    aligned, inside, gains = aligned_frames(pair, place_of_pixels(pair, there, flow))
    squares = inside * (aligned[1] - aligned[0]) ** 2 / 2
    seen = np.maximum(to_nodes(inside[np.newaxis].astype(np.float64))[0], 1)
    now = to_nodes(squares[np.newaxis])[0] * area / seen
    # how well the flow so far explains the second frame around each node, 0 to 1
    *_, from_second = place_of_pixels(pair, -there, flow)
    around = gaussian_filter(squares, _AGREEMENT_PX) / pair.noise
    at_second = map_coordinates(around, from_second, order=1, mode="nearest")
    explained = to_nodes(np.clip(2 - at_second, 0, 1)[np.newaxis])[0] / area
    side = 2 * reach + 1
    costs = np.empty((*now.shape, side**2 + 1), np.float32)
    equal = (pair.roots * gains).astype(np.float32)
    messages.fill_costs(equal, now, area * pair.noise, leaving, _CLAIM * explained, costs)
    total = costs.copy()
    messages.add_messages(costs, flow, total)
    best = total.argmin(axis=-1)
    y, x = np.divmod(best, side)
    return np.where(best == side**2, flow, np.stack((x, y)) - float(reach)), equal


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
