"""Kernels of the search for whole displacements: costs at nodes, and messages between nodes.

Semi-global matching (Hirschmüller 2008): a label per node minimizes the costs of displacements, as
negative log-likelihoods, and of changes between neighbors, by messages along eight directions. The
last label is the flow so far.
"""

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled
from megalopta.flow.likelihood.roots import NODE_PX, misfit

Singles = NDArray[np.float32]

REACH_PX = 8
"""Largest displacement along x and y, px of a level"""
SIDE = 2 * REACH_PX + 1
"""Displacements along an axis"""
_STEP, _JUMP = 0.7, 3.0
"""Costs of a change by one pixel along one axis, and of any change; fitted to dead leaves and disks
with motion up to 20 px, of other seeds than those reported, as all constants here"""
_CHANGE_PER_PX = 0.5
"""Cost of a change within the flow so far"""
_LEAST_SEEN = 0.5
"""Share of the pixels of a node that must be in all frames"""


@compiled(fastmath={"reassoc", "contract"})
def fill_costs(pair: Singles, now: Floats, noise: float, costs: Singles) -> None:
    """Write the cost of each displacement, (n, m, displacements), and of the flow so far.

    `now` (n, m): squares of the flow so far; `noise`: their mean where it is right.
    """
    area = NODE_PX**2
    costs[..., -1] = 2 * noise * misfit(now / noise)
    squares = np.empty(now.shape)
    for label in range(SIDE**2):
        down, right = label // SIDE - REACH_PX, label % SIDE - REACH_PX
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
def add_messages(costs: Singles, nodes: Floats, down: int, right: int, total: Singles) -> None:
    """Add to the total the messages to each node from those before it, in one direction."""
    rows, columns, labels = costs.shape
    before, here = np.zeros((2, columns, labels), np.float32)
    known = np.empty(labels, np.float32)
    for i in range(rows):
        y = i if down >= 0 else rows - 1 - i
        for j in range(columns):
            x = j if right >= 0 else columns - 1 - j
            above, left = y - down, x - right
            if 0 <= above < rows and 0 <= left < columns:
                message = before[left] if down else here[left]
                for label in range(labels):
                    known[label] = costs[above, left, label] + message[label]
                _pass_on(known, nodes[:, above, left], nodes[:, y, x], here[x])
                for label in range(labels):
                    total[y, x, label] += here[x, label]
            else:
                here[x] = 0.0
        before, here = here, before


@compiled
def _pass_on(known: Singles, before: Floats, here: Floats, sent: Singles) -> None:
    """Write the least cost of each label here, given that of each label before, less the least."""
    last = len(known) - 1
    step, least = np.float32(_STEP), known.min()
    sent[:] = known
    for row in range(0, last, SIDE):
        _lower(sent[row + 1 : row + SIDE], known[row : row + SIDE - 1], step)
        _lower(sent[row : row + SIDE - 1], known[row + 1 : row + SIDE], step)
    _lower(sent[SIDE:last], known[: last - SIDE], step)
    _lower(sent[: last - SIDE], known[SIDE:last], step)
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
def _lower(costs: Singles, neighbors: Singles, step: float) -> None:
    """Lower costs to those of neighboring labels and a step, in place."""
    for label in range(len(costs)):
        cost = neighbors[label] + step
        costs[label] = cost if cost < costs[label] else costs[label]


@compiled
def _nearest(flow: Floats) -> int:
    """Return the label of the whole displacement nearest to a flow (2,), -1 beyond reach."""
    x, y = int(np.rint(flow[0])) + REACH_PX, int(np.rint(flow[1])) + REACH_PX
    return y * SIDE + x if 0 <= x < SIDE and 0 <= y < SIDE else -1
