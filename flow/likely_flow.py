"""Flow of whole frames by likelihood: from the coarsest scale to the finest.

At each scale, Newton steps, each with a new warp, find the flow at nodes 4 px apart that is most
likely under a prior of the change of velocity with heavy tails: proportional to its size when
small, to its logarithm when large. Each solves a sparse symmetric system of two unknowns a node by
factorization, or by conjugate gradients from the factors of a similar one, so that evidence reaches
any distance in one step. At the finest scales, whole displacements that are likelier replace the
flow first (`large_motion`). Equations, sources and limits: `docs/theory/whole-frame-flow.md`.

**The covariance** at nodes is the inverse of the information, where the flow is found. At the most
likely flow, evidence and prior are a quadratic form with the matrix A + P: A has a block of 2 × 2
per node, the information, P ties neighbors. The blocks on the diagonal of the inverse are the
covariances of nodes (Laplace's approximation). A row of nodes is tied to the rows beside it alone,
so the matrix is block tridiagonal, and these blocks of its inverse follow exactly from two passes,
one down and one up (Takahashi's equations).
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.flow.large_motion import with_large_motion
from megalopta.flow.likelihood import (
    NODE_PX,
    Level,
    MostLikely,
    evidence,
    finer,
    halved,
    has_dark_frame,
    level_of,
    levels,
    place_of_pixels,
    times_from_reference,
    to_nodes,
    without_defects,
)


def node_covariance(information: Floats, springs: tuple[Floats, Floats]) -> Floats:
    """Return the covariances (3, n, m) of nodes, px²: xx, xy, yy.

    As for `likelihood.MostLikely`: `information` (3, n, m), and `springs` (n, m − 1), (n − 1, m)
    to the right neighbor and to the lower. Some node must have information.
    """
    is_wide = information.shape[1] < information.shape[2]
    if is_wide:  # blocks of the shorter side
        right, below = springs
        found = node_covariance(information.transpose(0, 2, 1), (below.T, right.T))
        return found.transpose(0, 2, 1)
    rows = information.shape[1]
    down = np.pad(np.tile(springs[1], 2), ((1, 1), (0, 0)))  # of both components
    width = information.shape[2]
    node = np.arange(width)
    # inverse of each row, given all above
    above: list[Floats] = []
    for row in range(rows):
        xx, xy, yy = information[:, row]
        right, vertical = springs[0][row], down[row] + down[row + 1]
        pull = np.pad(right, (1, 0)) + np.pad(right, (0, 1))
        # the matrix of a row, x of all nodes before y
        block = np.diag(np.concatenate((xx + pull, yy + pull)) + vertical)
        block[node, node + width] = block[node + width, node] = xy
        for first in (node[:-1], node[:-1] + width):
            block[first, first + 1] = block[first + 1, first] = -right
        if row:
            block -= down[row][:, np.newaxis] * above[-1] * down[row]
        above.append(np.asarray(np.linalg.inv(block), np.float64))
    found, last = np.empty_like(information), above[-1]
    found[:, -1] = _blocks(last)
    for row in range(rows - 2, -1, -1):
        tied = above[row] * down[row + 1]
        last = np.asarray(above[row] + tied @ last @ tied.T)
        found[:, row] = _blocks(last)
    return found


def _blocks(inverse: Floats) -> Floats:
    """Return xx, xy, yy of the nodes of a row, (3, m), from its matrix (2m, 2m)."""
    width = len(inverse) // 2
    diagonal = np.diag(inverse)
    return np.stack((diagonal[:width], np.diag(inverse, width), diagonal[width:]))


_MOST_BINS = 4
"""Pixels along a side of the coarsest bins at which large motion is sought"""

_STEADY, _LARGE = 0.003, 1.0
"""Changes of velocity per pixel, 1/frame: below the first the prior is quadratic, above the second
it grows as a logarithm"""

_NARROWER, _DIM_PHOTONS = 12.0, 60.0
"""Factor of the prior in the covariance in bright light: most motions are smoother than the prior
allows; and photons per pixel in all frames below which it falls, as the flow is then smoother than
motions are. Between the factors for slow and fast tuning scenes of the benchmark; in dim light
larger, for smooth motion"""

_FIRST_STEPS, _NEWTON_STEPS, _PRIOR_STEPS = 30, 3, 2
"""Newton steps at the coarsest scale, which start from no motion and are cheap, and at others"""
_LONGEST_STEP_PX = 1.0
_FEW_PHOTONS, _CHARGE_POWER = 20.0, 0.3
"""Photons per pixel in all frames; fitted to dead leaves and forests, with the smoothness of
`PoissonFlow`: with fewer, full smoothness loses small moving objects. With more, interpolation,
edges and changes of motion leave more error than photons do, and the likelihood is too sure: at the
finest scale the prior grows on, as fitted to the tuning scenes of the benchmark. At coarser
ones, which keep parts that move differently apart, it does not"""

_MANY_PHOTONS = 20_000.0
"""Photons per pixel in all frames above which the prior stays as it is: what frames differ by is no
longer shot noise, so the evidence does not grow"""


def likelihood_flow(counts: NDArray[Any], smoothness: float) -> Floats:
    """Return the flow (H, W, 2), px per frame, of the frame before the middle.

    `counts` (n, H, W): frames of one steady motion, two or more; `smoothness`: penalty in
    log-likelihood per pixel and unit of the flow's gradient, of 20 photons per pixel in all frames.
    NaN if a frame has no photon.

    Raises ValueError for a single frame.
    """
    if has_dark_frame(counts):
        return np.full((*counts.shape[1:], 2), np.nan)
    nodes, _ = _most_likely_flow(counts, smoothness)
    return _at_pixels(nodes, counts)


def refined_flow(counts: NDArray[Any], flow: Floats, smoothness: float) -> Floats:
    """Return a flow (H, W, 2) after one Newton step on frames (n, H, W) binned by 2 × 2 px.

    Sides have four pixels or more. Smoothness as in `likelihood_flow`, without its growth in bright
    light; NaN if a frame has no photon.
    """
    if has_dark_frame(counts):
        return np.full_like(flow, np.nan)
    bins = 2
    level = level_of(halved(counts.astype(np.float64)), bins)
    sums = to_nodes(halved(np.moveaxis(flow, -1, 0)))
    pixels = bins**2 * to_nodes(np.ones((1, *level.roots.shape[1:])))
    nodes = sums / (bins * pixels)
    charge = bins * charge_of(counts, smoothness)
    step = _step(level, times_from_reference(len(counts)), nodes, charge, MostLikely())
    return bins * np.moveaxis(finer(nodes + step, counts.shape[1:], bins * NODE_PX), 0, -1)


def flow_and_covariance(counts: NDArray[Any], smoothness: float) -> tuple[Floats, Floats]:
    """Return the flow as `likelihood_flow`, and its covariances (H, W, 2, 2), px² per frame².

    The inverse of the information of evidence and prior at nodes, interpolated; the prior's is
    multiplied by a factor that depends on the light. Where frames do not agree, as where something
    is hidden, evidence is reduced and the covariance large. NaN, and raises, as `likelihood_flow`.
    """
    if has_dark_frame(counts):
        return likelihood_flow(counts, smoothness), np.full((*counts.shape[1:], 2, 2), np.nan)
    charge, times = charge_of(counts, smoothness), times_from_reference(len(counts))
    nodes, level = _most_likely_flow(counts, smoothness)
    found = evidence(level, times[np.newaxis], place_of_pixels(level, times, nodes))
    narrower = _NARROWER / (1 + _DIM_PHOTONS / counts.sum(axis=0).mean())
    information = to_nodes(found.products[0] * found.information)
    covariance = node_covariance(information, _springs(nodes, narrower * charge))
    at_pixels = _at_pixels(covariance, counts)
    return _at_pixels(nodes, counts), at_pixels[..., [[0, 1], [1, 2]]]


def _most_likely_flow(counts: NDArray[Any], smoothness: float) -> tuple[Floats, Level]:
    """Return the flow at nodes, (2, n, m), and the finest level."""
    if len(counts) < 2:
        raise ValueError("one frame has no flow: give two or more")
    times = times_from_reference(len(counts))
    nodes = np.zeros((2, 1, 1))
    for number, level in enumerate(levels(without_defects(counts))):
        here = level.roots.shape[1:]
        nodes = 2 * finer(nodes, tuple(-(-side // NODE_PX) for side in here), 2)
        charge = level.bins * charge_of(counts, smoothness, 1.0 if level.bins > 1 else math.inf)
        steps = _NEWTON_STEPS if number else _FIRST_STEPS
        if level.bins <= _MOST_BINS:
            if number == 0:  # whole displacements compete with the best flow near no motion
                nodes = _refined(level, times, nodes, charge, steps)
            nodes = with_large_motion(level, times, nodes)
        nodes = _refined(level, times, nodes, charge, steps)
    return nodes, level


def _refined(level: Level, times: Floats, nodes: Floats, charge: float, steps: int) -> Floats:
    most_likely = MostLikely()
    for _ in range(steps):
        nodes = nodes + _step(level, times, nodes, charge, most_likely)
    return nodes


def _at_pixels(nodes: Floats, counts: NDArray[Any]) -> Floats:
    """Return values at nodes (k, n, m) at the pixels of frames, (H, W, k)."""
    return np.moveaxis(finer(nodes, counts.shape[1:], NODE_PX), 0, -1)


def charge_of(counts: NDArray[Any], smoothness: float, most: float = 1.0) -> float:
    """Return the penalty of counts (n, H, W) per unit of the gradient of their flow.

    It grows with the photons, to `most` times the smoothness.
    """
    photons = min(counts.sum(axis=0).mean(), _MANY_PHOTONS)
    return float(smoothness * min(most, (photons / _FEW_PHOTONS) ** _CHARGE_POWER))


def stiffness(charge: float, squared_change: Floats) -> Floats:
    """Return the stiffness (n, m) of links with a squared change of flow (n, m), px²."""
    change = np.sqrt(squared_change / NODE_PX**2 + _STEADY**2)
    return np.asarray(charge / (change * (1 + change / _LARGE)))


def _step(
    level: Level, times: Floats, nodes: Floats, smoothness: float, most_likely: MostLikely
) -> Floats:
    """Return the step from a flow at nodes, (2, n, m)."""
    found = evidence(level, times[np.newaxis], place_of_pixels(level, times, nodes))
    information, slope = to_nodes(found.products[0] * found.information), to_nodes(found.slope[0])
    xx, xy, yy = information
    x, y = nodes
    target = slope + np.stack((xx * x + xy * y, xy * x + yy * y))
    best = nodes
    for _ in range(_PRIOR_STEPS):
        best = most_likely(information, target, _springs(best, smoothness), best)
    return np.clip(best - nodes, -_LONGEST_STEP_PX, _LONGEST_STEP_PX)


def _springs(nodes: Floats, charge: float) -> tuple[Floats, Floats]:
    """Return the stiffness of links of a flow (2, n, m) to the right, and downward."""
    right, down = ((np.diff(nodes, axis=axis) ** 2).sum(axis=0) for axis in (2, 1))
    return stiffness(charge, right), stiffness(charge, down)
