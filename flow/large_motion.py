"""Large motion: the most likely of all whole displacements, before Newton steps refine a flow.

Newton steps follow the likelihood uphill. What moves by more than its texture is wide, against its
surroundings, lies beyond their reach. So the squared differences of aligned frames are summed over
the square around each node for every whole displacement up to `_REACH_PX` of the level, and for the
flow so far. A label per node minimizes these costs, as negative log-likelihoods, and the costs of
changes between neighbors, by messages along eight directions (semi-global matching, Hirschmüller
2008). A change to any displacement costs at most `_JUMP`: the prior has heavy tails.

Each place of the second frame belongs to one place of the first: displacements to where the flow
so far explains what is seen cost more. Squares that fit no displacement, as where something is
hidden, count with their logarithm, as in `likelihood.evidence`. Where a displacement leaves the
frame, it is no better than the flow so far.
"""

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled
from megalopta.flow.likelihood import (
    NODE_PX,
    Level,
    aligned_frames,
    misfit,
    place_of_pixels,
    to_nodes,
)

_REACH_PX = 8
_STEP, _JUMP = 0.7, 3.0
"""Costs of a change by one pixel along one axis, and of any change; fitted to dead leaves and disks
with motion up to 20 px, of other seeds than those reported, as all constants here"""
_CHANGE_PER_PX = 0.5
"""Cost of a change within the flow so far"""
_LEAVING = 0.25
"""Cost per frame but one of any other displacement than that of the flow so far, which coarser
scales and all frames have voted for"""

_CLAIM = 1.0
"""Cost of a displacement to a place of the second frame that the flow so far explains: what is
hidden in one frame resembles something in the other by chance"""
_SHIFTS = np.arange(-_REACH_PX, _REACH_PX + 1)
_AGREEMENT_PX = 2.0
"""Standard deviation of the neighborhood in which frames are compared"""

_DARK = 1e-9
"""Least mean root of a frame, for a defined result"""
_LEAST_SEEN = 0.5
"""Share of the pixels of a node that must be in all frames"""
_DIRECTIONS = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1), (1, -1), (-1, 1))


def with_large_motion(level: Level, times: Floats, nodes: Floats) -> Floats:
    """Return the flow at nodes (2, n, m), px, where another displacement is likelier, that one.

    The two frames in the middle tell: in frames farther apart, a fraction of a pixel is many.
    """
    side, area = 2 * _REACH_PX + 1, NODE_PX**2
    pair = np.s_[len(times) // 2 - 1 : len(times) // 2 + 1]
    middle = level._replace(roots=level.roots[pair], splines=level.splines[pair])
    aligned, inside = aligned_frames(middle, place_of_pixels(middle, times[pair], nodes))
    squares = inside * (aligned[1] - aligned[0]) ** 2 / 2
    seen = np.maximum(to_nodes(inside[np.newaxis].astype(np.float64))[0], 1)
    now = to_nodes(squares[np.newaxis])[0] * area / seen
    costs = np.empty((*now.shape, side**2 + 1))
    brightness = middle.roots.mean(axis=(1, 2), keepdims=True)
    _fill(middle.roots * (brightness.mean() / np.maximum(brightness, _DARK)), now, costs)
    noise = area * level.noise
    costs = 2 * noise * misfit(costs / noise)
    costs[..., :-1] += _LEAVING * (len(times) - 1)
    _add_claims(costs, _explained(middle, nodes, squares))
    total = costs.copy()
    for down, right in _DIRECTIONS:
        _add_messages(costs, nodes, down, right, total)
    best = total.argmin(axis=-1)
    y, x = np.divmod(best, side)
    return np.where(best == side**2, nodes, np.stack((x, y)) - float(_REACH_PX))


def _explained(pair: Level, nodes: Floats, squares: Floats) -> Floats:
    """Return how well the flow so far explains the second frame around each node, 0 to 1."""
    *_, back = place_of_pixels(pair, np.array([0.0, -1.0]), nodes)
    around = gaussian_filter(squares, _AGREEMENT_PX) / pair.noise
    at_second = map_coordinates(around, back, order=1, mode="nearest")
    return np.asarray(to_nodes(np.clip(2 - at_second, 0, 1)[np.newaxis])[0] / NODE_PX**2)


def _add_claims(costs: Floats, explained: Floats) -> None:
    """Add the cost of displacements to a place of the second frame that is explained otherwise."""
    side = 2 * _REACH_PX + 1
    middles = (NODE_PX * np.arange(count) + NODE_PX // 2 for count in explained.shape)
    down, right = ((middle + _SHIFTS[:, np.newaxis]) // NODE_PX for middle in middles)
    rows, columns = (each.clip(0, each[_REACH_PX, -1]) for each in (down, right))
    for label in range(side**2):
        row, column = rows[label // side], columns[label % side]
        costs[..., label] += _CLAIM * explained[np.ix_(row, column)]


@compiled(fastmath={"reassoc", "contract"})
def _fill(pair: Floats, now: Floats, costs: Floats) -> None:
    """Write the squares of each displacement, (n, m, displacements), and of the flow so far."""
    side, area = 2 * _REACH_PX + 1, NODE_PX**2
    costs[..., -1] = now
    seen = np.empty(now.shape)
    squares = np.empty(now.shape)
    for label in range(side**2):
        squares[:] = 0.0
        seen[:] = 0.0
        _sum_squares(pair, label // side - _REACH_PX, label % side - _REACH_PX, squares, seen)
        for y in range(now.shape[0]):
            for x in range(now.shape[1]):
                cost = squares[y, x] * area / max(seen[y, x], 1.0)
                is_seen = seen[y, x] >= _LEAST_SEEN * area
                costs[y, x, label] = cost if is_seen else max(cost, now[y, x])


@compiled(fastmath={"reassoc", "contract"})
def _sum_squares(pair: Floats, down: int, right: int, squares: Floats, seen: Floats) -> None:
    """Add squared differences from the mean of two frames, the second displaced, at nodes."""
    _, height, width = pair.shape
    for y in range(max(0, -down), min(height, height - down)):
        for x in range(max(0, -right), min(width, width - right)):
            difference = pair[1, y + down, x + right] - pair[0, y, x]
            squares[y // NODE_PX, x // NODE_PX] += difference * difference / 2
            seen[y // NODE_PX, x // NODE_PX] += 1.0


@compiled
def _add_messages(costs: Floats, nodes: Floats, down: int, right: int, total: Floats) -> None:
    """Add to the total what the nodes before each one say of its labels, in one direction."""
    rows, columns, labels = costs.shape
    sent = np.zeros((rows, columns, labels))
    for i in range(rows):
        y = i if down >= 0 else rows - 1 - i
        for j in range(columns):
            x = j if right >= 0 else columns - 1 - j
            above, left = y - down, x - right
            if 0 <= above < rows and 0 <= left < columns:
                known = costs[above, left] + sent[above, left]
                _pass_on(known, nodes[:, above, left], nodes[:, y, x], sent[y, x])
                total[y, x] += sent[y, x]


@compiled
def _pass_on(known: Floats, before: Floats, here: Floats, sent: Floats) -> None:
    """Write the least cost of each label here, given that of each label before, less the least."""
    side, least, last = 2 * _REACH_PX + 1, known.min(), len(known) - 1
    for label in range(last):
        x, cost = label % side, known[label]
        cost = min(cost, known[label - 1] + _STEP) if x > 0 else cost
        cost = min(cost, known[label + 1] + _STEP) if x < side - 1 else cost
        cost = min(cost, known[label - side] + _STEP) if label >= side else cost
        cost = min(cost, known[label + side] + _STEP) if label < last - side else cost
        sent[label] = min(cost - least, _JUMP)
    change = abs(here[0] - before[0]) + abs(here[1] - before[1])
    sent[last] = min(known[last] - least + _CHANGE_PER_PX * change, _JUMP)
    nearest_here, nearest_before = _nearest(here), _nearest(before)
    if nearest_here >= 0:  # from a whole displacement to the flow so far
        sent[last] = min(sent[last], known[nearest_here] - least + _STEP / 2)
    if nearest_before >= 0:
        sent[nearest_before] = min(sent[nearest_before], known[last] - least + _STEP / 2)


@compiled
def _nearest(flow: Floats) -> int:
    """Return the label of the whole displacement nearest to a flow (2,), -1 beyond reach."""
    x, y = int(np.rint(flow[0])) + _REACH_PX, int(np.rint(flow[1])) + _REACH_PX
    side = 2 * _REACH_PX + 1
    return y * side + x if 0 <= x < side and 0 <= y < side else -1
