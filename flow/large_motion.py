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
from numpy.typing import NDArray
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

Singles = NDArray[np.float32]

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
    costs = np.empty((*now.shape, side**2 + 1), np.float32)
    brightness = middle.roots.mean(axis=(1, 2), keepdims=True)
    equal = middle.roots * (brightness.mean() / np.maximum(brightness, _DARK))
    _fill(equal.astype(np.float32), now, area * level.noise, costs)
    costs[..., :-1] += _LEAVING * (len(times) - 1)
    # how well the flow so far explains the second frame around each node, 0 to 1
    *_, back = place_of_pixels(middle, np.array([0.0, -1.0]), nodes)
    around = gaussian_filter(squares, _AGREEMENT_PX) / middle.noise
    at_second = map_coordinates(around, back, order=1, mode="nearest")
    explained = to_nodes(np.clip(2 - at_second, 0, 1)[np.newaxis])[0] / area
    # displacements to a place of the second frame that is explained otherwise cost more
    middles = (NODE_PX * np.arange(count) + NODE_PX // 2 for count in explained.shape)
    places = ((centers + _SHIFTS[:, np.newaxis]) // NODE_PX for centers in middles)
    rows, columns = (place.clip(0, place[_REACH_PX, -1]) for place in places)
    for label in range(side**2):
        row, column = rows[label // side], columns[label % side]
        costs[..., label] += _CLAIM * explained[np.ix_(row, column)]
    total = costs.copy()
    for down, right in _DIRECTIONS:
        _add_messages(costs, nodes, down, right, total)
    best = total.argmin(axis=-1)
    y, x = np.divmod(best, side)
    return np.where(best == side**2, nodes, np.stack((x, y)) - float(_REACH_PX))


@compiled(fastmath={"reassoc", "contract"})
def _fill(pair: Singles, now: Floats, noise: float, costs: Singles) -> None:
    """Write the cost of each displacement, (n, m, displacements), and of the flow so far.

    `now` (n, m): squares of the flow so far; `noise`: their mean where it is right.
    """
    side, area = 2 * _REACH_PX + 1, NODE_PX**2
    costs[..., -1] = 2 * noise * misfit(now / noise)
    squares = np.empty(now.shape)
    for label in range(side**2):
        down, right = label // side - _REACH_PX, label % side - _REACH_PX
        _sum_squares(pair, down, right, squares)
        for y in range(now.shape[0]):
            tall = _overlap(pair.shape[1], down, y)
            for x in range(now.shape[1]):
                seen = tall * _overlap(pair.shape[2], right, x)
                cost = squares[y, x] * area / max(seen, 1)
                cost = cost if seen >= _LEAST_SEEN * area else max(cost, now[y, x])
                costs[y, x, label] = 2 * noise * misfit(cost / noise)


@compiled
def _overlap(length: int, shift: int, node: int) -> int:
    """Return how many of the pixels of a node along an axis are also in the displaced frame."""
    first = max(NODE_PX * node, -shift)
    return max(0, min(NODE_PX * (node + 1), length, length - shift) - first)


@compiled(fastmath={"reassoc", "contract"})
def _sum_squares(pair: Singles, down: int, right: int, squares: Floats) -> None:
    """Write squared differences from the mean of two frames, the second displaced, at nodes."""
    _, height, width = pair.shape
    first, last = max(0, -right), min(width, width - right)
    row = np.zeros(squares.shape[1] * NODE_PX, np.float32)
    squares[:] = 0.0
    for y in range(max(0, -down), min(height, height - down)):
        for x in range(first, last):
            difference = pair[1, y + down, x + right] - pair[0, y, x]
            row[x] = difference * difference / 2
        for node in range(squares.shape[1]):
            for x in range(NODE_PX):
                squares[y // NODE_PX, node] += row[NODE_PX * node + x]


@compiled
def _add_messages(costs: Singles, nodes: Floats, down: int, right: int, total: Singles) -> None:
    """Add to the total what the nodes before each one say of its labels, in one direction."""
    rows, columns, labels = costs.shape
    before, here = np.zeros((2, columns, labels), np.float32)
    known = np.empty(labels, np.float32)
    for i in range(rows):
        y = i if down >= 0 else rows - 1 - i
        for j in range(columns):
            x = j if right >= 0 else columns - 1 - j
            above, left = y - down, x - right
            if 0 <= above < rows and 0 <= left < columns:
                said = before[left] if down else here[left]
                for label in range(labels):
                    known[label] = costs[above, left, label] + said[label]
                _pass_on(known, nodes[:, above, left], nodes[:, y, x], here[x])
                for label in range(labels):
                    total[y, x, label] += here[x, label]
            else:
                here[x] = 0.0
        before, here = here, before


@compiled
def _pass_on(known: Singles, before: Floats, here: Floats, sent: Singles) -> None:
    """Write the least cost of each label here, given that of each label before, less the least."""
    side, last = 2 * _REACH_PX + 1, len(known) - 1
    step, least = np.float32(_STEP), known.min()
    sent[:] = known
    for row in range(0, last, side):
        _lower(sent[row + 1 : row + side], known[row : row + side - 1], step)
        _lower(sent[row : row + side - 1], known[row + 1 : row + side], step)
    _lower(sent[side:last], known[: last - side], step)
    _lower(sent[: last - side], known[side:last], step)
    change = abs(here[0] - before[0]) + abs(here[1] - before[1])
    sent[last] = known[last] + _CHANGE_PER_PX * change
    nearest_here, nearest_before = _nearest(here), _nearest(before)
    if nearest_here >= 0:  # from a whole displacement to the flow so far
        sent[last] = min(sent[last], known[nearest_here] + step / 2)
    if nearest_before >= 0:
        sent[nearest_before] = min(sent[nearest_before], known[last] + step / 2)
    for label in range(last + 1):
        cost = sent[label] - least
        sent[label] = cost if cost < _JUMP else np.float32(_JUMP)


@compiled(fastmath={"nnan", "nsz"}, inline="always")
def _lower(costs: Singles, others: Singles, step: float) -> None:
    """Lower costs to those of other labels and a step, in place."""
    for label in range(len(costs)):
        other = others[label] + step
        costs[label] = other if other < costs[label] else costs[label]


@compiled
def _nearest(flow: Floats) -> int:
    """Return the label of the whole displacement nearest to a flow (2,), -1 beyond reach."""
    x, y = int(np.rint(flow[0])) + _REACH_PX, int(np.rint(flow[1])) + _REACH_PX
    side = 2 * _REACH_PX + 1
    return y * side + x if 0 <= x < side and 0 <= y < side else -1
