"""Search for motion beyond the reach of Newton's steps, and where its parts end.

Whole displacements are found by semi-global matching (`messages`), from the first frame to the
second and back: only those that agree count. The motion of parts then spreads to their outlines
(`edges`).
"""

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from megalopta.core.arrays import Floats
from megalopta.flow.likelihood import alignment, edges, messages, roots
from megalopta.flow.likelihood.roots import AGREEMENT_PX, NODE_PX, Level

_REACH_PX, _REACH_SHARE = 8, 0.2
"""Largest displacement along x and y, px of a level; at coarse levels this share of the longer
side"""
_LEAVING = 0.5
"""Cost per frame but one of a small displacement other than the flow so far, which coarser scales
and all frames have voted for; it grows with the displacement's logarithm; fitted as the costs in
`messages`"""
_CLAIM = 1.0
"""Cost of a displacement to a place of the second frame that the flow so far explains: what is
hidden in one frame resembles something in the other by chance"""
AGREES_PX = 1.5
"""Distance from the start after a motion and the motion back below which they agree"""
_BETTER, _BETTER_NODES = 1.0, 2.0
"""Misfit of a node by which a proposal must be better, and the neighborhood of nodes that tells"""


def with_large_motion(level: Level, frames: int, flow: Floats) -> Floats:
    """Return the flow at nodes (2, n, m), px, where another displacement is likelier, that one.

    `level`: of the two frames in the middle of so many: in frames farther apart, a fraction of a
    pixel is many.
    """
    reach = round(_REACH_SHARE * max(level.roots.shape[1:]))
    if level.bins < 4:  # px per side of bins: a fine level
        reach = _REACH_PX
    leaving = _LEAVING * (frames - 1)
    back = level._replace(roots=level.roots[::-1], splines=level.splines[::-1])
    displaced = _displaced(level, flow, reach, leaving)
    returned = _displaced(back, -flow, reach, leaving)
    distance = NODE_PX * alignment.round_trip(displaced / NODE_PX, returned / NODE_PX)
    merged = np.where(distance < AGREES_PX, displaced, flow)
    edges.spread(equal_roots(level, merged), level.noise, merged)
    return merged


def with_proposal(level: Level, flow: Floats, proposal: Floats, returned: Floats) -> Floats:
    """Return the flow at nodes (2, n, m), px, where a proposal aligns the two frames better, that.

    It counts where it agrees with the flow `returned` from the second frame to the first; both
    (2, H, W).
    """
    seen = alignment.to_nodes(np.ones((1, *proposal.shape[1:])))
    agree = (alignment.round_trip(proposal, returned) < AGREES_PX).astype(np.float64)
    agrees = alignment.to_nodes(agree[np.newaxis]) / seen > 0.5
    proposed = alignment.to_nodes(proposal) / seen
    misfits = []
    for motion in (flow, proposed):
        places = alignment.place_of_pixels(level, motion)
        aligned, inside, _ = alignment.aligned_frames(level, places)
        around = gaussian_filter((aligned[1] - aligned[0]) ** 2 / 2, 1.0) / level.noise
        misfit = np.where(inside, roots.misfit(around), roots.MOST_NOISE)
        misfits.append(alignment.to_nodes(misfit[np.newaxis]))
    better = gaussian_filter((misfits[0] - misfits[1])[0], _BETTER_NODES) > _BETTER
    return np.where(agrees & better, proposed, flow)


def sharp_flow(level: Level, flow: Floats) -> Floats:
    """Return the flow (2, H, W) of pixels, given that at nodes (2, n, m), for the two frames.

    Interpolated; between nodes of different motion each pixel has that of the likeliest.
    """
    pixels = alignment.finer(flow, level.roots.shape[1:], NODE_PX)
    edges.sharpen(equal_roots(level, flow), level.noise, flow, pixels)
    return pixels


def equal_roots(level: Level, flow: Floats) -> messages.Singles:
    """Return the roots of two frames (2, H, W), equally bright given a flow at nodes nearby."""
    _, _, gains = alignment.aligned_frames(level, alignment.place_of_pixels(level, flow))
    return np.asarray(level.roots * gains, np.float32)


def _displaced(level: Level, flow: Floats, reach: int, leaving: float) -> Floats:
    """Return the flow with whole displacements up to a reach."""
    aligned, inside, gains = alignment.aligned_frames(level, alignment.place_of_pixels(level, flow))
    squares = inside * (aligned[1] - aligned[0]) ** 2 / 2
    # how well the flow so far explains the second frame, 0 to 1
    *_, from_second = alignment.place_of_pixels(level, -flow)
    around = gaussian_filter(squares, AGREEMENT_PX) / level.noise
    explained = np.clip(2 - map_coordinates(around, from_second, order=1, mode="nearest"), 0, 1)
    now, seen, explained = alignment.to_nodes(np.stack((squares, inside, explained)))
    area, side = NODE_PX**2, 2 * reach + 1
    now *= area / np.maximum(seen, 1)
    costs = np.empty((*now.shape, side**2 + 1), np.float32)
    equal = np.asarray(level.roots * gains, np.float32)
    claims = _CLAIM / area * explained
    messages.fill_costs(equal, now, area * level.noise, leaving, claims, costs)
    total = costs.copy()
    messages.add_messages(costs, flow, total)
    best = total.argmin(axis=-1)
    y, x = np.divmod(best, side)
    return np.where(best == side**2, flow, np.stack((x, y)) - float(reach))
