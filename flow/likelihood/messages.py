"""Kernels of the search for whole displacements: costs at nodes, and messages between nodes.

Semi-global matching (Hirschmüller 2008): a label per node minimizes the costs of displacements, as
negative log-likelihoods, and of changes between neighbors, by messages along eight directions. The
last label is the flow so far.
"""

import math

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled
from megalopta.flow.likelihood.roots import NODE_PX, misfit

Singles = NDArray[np.float32]

STEP, JUMP = 0.7, 3.0
"""Costs of a change by one pixel along one axis, and of any change; fitted to dead leaves and disks
with motion up to 20 px, of other seeds than those reported, as all constants here"""


@compiled(fastmath={"reassoc", "contract"})
def fill_costs(
    pair: Singles, now: Floats, noise: float, leaving: float, claims: Floats, costs: Singles
) -> None:
    """Write the cost of each displacement, (n, m, displacements), and of the flow so far.

    Displacements reach equally far along x and y: with the flow so far, (2·reach + 1)² + 1.

    `now` (n, m): squares of the flow so far; `noise`: their mean where it is right; `leaving`: cost
    of any displacement; `claims` (n, m): cost of one to a node.
    """
    _, height, width = pair.shape
    rows, columns, labels = costs.shape
    side, area = int(math.sqrt(labels - 1)), NODE_PX**2
    squares = np.empty(columns * NODE_PX, np.float32)
    for y in range(rows):
        for label in range(labels - 1):
            down, right = label // side - side // 2, label % side - side // 2
            far = leaving * (1 + math.log1p(math.hypot(down, right) / NODE_PX))
            first = max(0, -right)
            last = max(first, min(width, width - right))
            squares[:] = 0
            for i in range(max(NODE_PX * y, -down), min(NODE_PX * (y + 1), height, height - down)):
                second = pair[1, i + down, first + right : last + right]
                total, here = squares[first:last], pair[0, i, first:last]
                for x in range(last - first):
                    total[x] += (second[x] - here[x]) ** 2
            tall = _overlap(height, down, y)
            row = min(max(y + (down + NODE_PX // 2) // NODE_PX, 0), rows - 1)
            for x in range(columns):
                seen = tall * _overlap(width, right, x)
                cost = squares[NODE_PX * x : NODE_PX * (x + 1)].sum() / 2 * area / max(seen, 1)
                # at least half of a node must be in all frames
                cost = cost if seen >= 0.5 * area else max(cost, now[y, x])
                column = min(max(x + (right + NODE_PX // 2) // NODE_PX, 0), columns - 1)
                of_squares = 2 * noise * misfit(cost / noise)
                costs[y, x, label] = of_squares + far + claims[row, column]
    costs[..., -1] = 2 * noise * misfit(now / noise)


@compiled
def _overlap(length: int, shift: int, node: int) -> int:
    """Return how many of the pixels of a node along an axis are also in the displaced frame."""
    first = max(NODE_PX * node, -shift)
    return max(0, min(NODE_PX * (node + 1), length, length - shift) - first)


@compiled
def add_messages(costs: Singles, nodes: Floats, total: Singles) -> None:
    """Add to the total the messages to each node from those before it, along eight directions.

    Costs, (n, m, displacements), are 0 or more; `nodes` (2, n, m): flow so far.
    """
    rows, columns, labels = costs.shape
    last, side = labels - 1, int(math.sqrt(labels - 1))
    # costs of a change by one pixel from the left and from the right; a row of labels ends
    from_left = np.full(last, STEP, np.float32)
    from_left[::side] = np.inf
    from_right = from_left[::-1].copy()
    bordered = np.full(last + 2 * side, np.inf, np.float32)
    known, half_step = bordered[side : side + last], np.float32(STEP / 2)
    for way in (1, -1):
        received = np.zeros((2, columns, 4, labels), np.float32)
        for y in np.arange(rows)[::way]:
            for x in np.arange(columns)[::way]:
                for k in range(4):  # along the row, and to three nodes of the next one
                    message = received[y % 2, x, k]
                    least = _gather(costs[y, x], message, total[y, x], known)
                    b, a = (y, x + way) if k == 0 else (y + way, x + k - 2)
                    if not (0 <= b < rows and 0 <= a < columns):
                        continue
                    sent = received[b % 2, a, k]
                    _pass_on(bordered, from_left, from_right, least, sent)
                    # between whole displacements and the flow so far
                    before, after = nodes[:, y, x], nodes[:, b, a]
                    stays = costs[y, x, last] + message[last]
                    change = abs(after[0] - before[0]) + abs(after[1] - before[1])
                    cost = stays + np.float32(0.5 * change)  # per px of change in the flow so far
                    nearest_before, nearest_after = _nearest(before, side), _nearest(after, side)
                    if nearest_after >= 0:
                        cost = min(cost, known[nearest_after] + half_step)
                    if nearest_before >= 0:
                        from_flow = stays + half_step - least
                        sent[nearest_before] = min(sent[nearest_before], from_flow)
                    sent[last] = min(cost - least, np.float32(JUMP))


@compiled
def _gather(costs: Singles, message: Singles, total: Singles, known: Singles) -> np.float32:
    """Add a message to the total, and to the costs; return the least cost."""
    total[-1] += message[-1]
    for label in range(len(known)):
        total[label] += message[label]
        known[label] = costs[label] + message[label]
    least = np.float32(costs[-1] + message[-1]).view(np.int32)
    for bits in known.view(np.int32):  # of floats from 0, in the same order, but faster to compare
        least = bits if bits < least else least
    return np.int32(least).view(np.float32)


@compiled(fastmath={"nnan", "nsz"})
def _pass_on(
    bordered: Singles, from_left: Singles, from_right: Singles, least: np.float32, sent: Singles
) -> None:
    """Write the least cost of each displacement here, given that of each before, less the least."""
    last, step, jump = len(from_left), np.float32(STEP), np.float32(JUMP)
    side = (len(bordered) - last) // 2
    known, left, right = bordered[side:], bordered[side - 1 :], bordered[side + 1 :]
    lower = bordered[2 * side :]
    for label in range(last):
        above, below = bordered[label], lower[label]
        cost = (above if above < below else below) + step
        beside = left[label] + from_left[label]
        cost = beside if beside < cost else cost
        beside = right[label] + from_right[label]
        cost = beside if beside < cost else cost
        cost = (known[label] if known[label] < cost else cost) - least
        sent[label] = cost if cost < jump else jump


@compiled
def _nearest(flow: Floats, side: int) -> int:
    """Return the label of the whole displacement nearest to a flow (2,), -1 beyond reach."""
    x, y = int(np.rint(flow[0])) + side // 2, int(np.rint(flow[1])) + side // 2
    return y * side + x if 0 <= x < side and 0 <= y < side else -1
