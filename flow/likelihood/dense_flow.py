"""The flow of a whole frame under which counts of several frames are most likely.

Frames are matched from the coarsest scale to the finest (`evidence`). At each the flow,
known at nodes 4 px apart, is the least of

    Σ over pixels of 2·Σₜ (gₜ(x + sₜ·u) − mean)²  +  Σ over links of prior(|change of u| / distance)

gₜ are roots of the counts, smoothed; the first sum is their log-likelihood for a steady motion u,
with sₜ the time from the frame of reference. So the weight of evidence against smoothness follows
from the photons themselves, but for a small correction where they are few. A place without texture,
whose Fisher information is 0, takes its velocity from its neighbors. The prior grows as the change
of velocity, not its square: it allows edges. Newton steps, warping anew each time, go on with the
roots interpolated by cubic splines.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.flow.likelihood.evidence import (
    NODE_PX,
    Level,
    evidence,
    finer,
    levels,
    to_nodes,
)
from megalopta.flow.likelihood.node_system import most_likely

_STEADY = 0.003
"""Change of velocity per pixel below which the prior is quadratic, 1/frame"""

_NEWTON_STEPS, _PRIOR_STEPS = 4, 2
_LONGEST_STEP_PX = 1.0
_FEW_PHOTONS, _CHARGE_POWER = 20.0, 0.3
"""Per pixel in all frames; fitted to dead leaves and forests, with the smoothness of `PoissonFlow`:
with fewer, full smoothness loses small things that move for themselves"""


def likelihood_flow(counts: NDArray[Any], smoothness: float) -> Floats:
    """Return the flow (H, W, 2), px per frame, of the frame before the middle; NaN in the dark.

    Parameters
    ----------
    counts : (n, H, W)
        Frames of one steady motion, two or more.
    smoothness : float
        Log-likelihood that a pixel's worth of flow is charged per unit of its gradient; less
        where there are few photons.

    Raises
    ------
    ValueError
        When there is one frame.
    """
    if len(counts) < 2:
        raise ValueError("one frame has no flow: give two or more")
    shape = (counts.shape[1], counts.shape[2])
    if not counts.any():
        return np.full((*shape, 2), np.nan)
    times = times_from_reference(len(counts))
    charge = charge_of(counts, smoothness)
    nodes = np.zeros((2, 1, 1))
    for level in levels(counts.astype(np.float64)):
        here = level.roots.shape[1:]
        nodes = 2 * finer(nodes, tuple(-(-side // NODE_PX) for side in here), 2)
        for _ in range(_NEWTON_STEPS):
            nodes = nodes + _step(level, times, nodes, charge * level.bins**2)
    return np.moveaxis(finer(nodes, shape, NODE_PX), 0, -1)


def times_from_reference(frames: int) -> Floats:
    """Return the times of so many frames from the one before the middle, (frames,)."""
    return np.arange(frames, dtype=np.float64) - (frames // 2 - 1)


def charge_of(counts: NDArray[Any], smoothness: float) -> float:
    """Return what counts (n, H, W) are charged per unit of the gradient of their flow."""
    photons = counts.sum(axis=0).mean()
    return float(smoothness * min(1.0, photons / _FEW_PHOTONS) ** _CHARGE_POWER)


def stiffness(charge: float, squared_change: Floats) -> Floats:
    """Return the stiffness (n, m) of links over which flow changes so: its square (n, m), px²."""
    return np.asarray(charge / np.sqrt(squared_change / NODE_PX**2 + _STEADY**2))


def _step(level: Level, times: Floats, nodes: Floats, smoothness: float) -> Floats:
    """Return how far to go from a flow at nodes, (2, n, m)."""
    shape = level.roots.shape[1:]
    pixels = np.mgrid[: shape[0], : shape[1]].astype(np.float64)
    flow = finer(nodes, shape, NODE_PX)[::-1]
    found = evidence(level, times[np.newaxis], (pixels + time * flow for time in times))
    information, slope = to_nodes(found.products[0] * found.information), to_nodes(found.slope[0])
    xx, xy, yy = information
    x, y = nodes
    target = slope + np.stack((xx * x + xy * y, xy * x + yy * y))
    best = nodes
    for _ in range(_PRIOR_STEPS):
        best = most_likely(information, target, _springs(best, smoothness))
    return np.clip(best - nodes, -_LONGEST_STEP_PX, _LONGEST_STEP_PX)


def _springs(nodes: Floats, smoothness: float) -> tuple[Floats, Floats]:
    """Return the stiffness of links along x and y: that of a prior that grows as the gradient."""
    right, down = (
        stiffness(smoothness, (np.diff(nodes, axis=axis) ** 2).sum(axis=0)) for axis in (2, 1)
    )
    return right, down
