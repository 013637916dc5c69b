"""Kernels for the edges of motion: how far its parts reach."""

import math

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled
from megalopta.flow.likelihood.messages import JUMP, STEP, Singles
from megalopta.flow.likelihood.roots import MOST_NOISE, NODE_PX, misfit

_SWEEPS, _SAME_PX = 4, 0.5
"""Sweeps over the nodes; change of motion below which neighbors have the same"""
_EDGE_PX, _PULL = 1.0, 4.0
"""Change of motion between nodes at an edge; cost of a node per squared distance, in nodes"""


@compiled(fastmath={"reassoc", "contract"})
def spread(pair: Singles, noise: float, flow: Floats) -> None:
    """Replace the flow of nodes (2, n, m), in place, by that of a neighbor where it is likelier.

    Sweeps alternate in direction, so that the motion of a part reaches its outline (PatchMatch).
    """
    rows, columns = flow.shape[1:]
    costs = np.empty((rows, columns), np.float32)
    for y in range(rows):
        for x in range(columns):
            costs[y, x] = _node_cost(pair, noise, y, x, flow[0, y, x], flow[1, y, x])
    for sweep in range(_SWEEPS):
        step = 1 if sweep % 2 == 0 else -1
        for i in range(rows):
            y = i if step > 0 else rows - 1 - i
            for j in range(columns):
                x = j if step > 0 else columns - 1 - j
                best_x, best_y = flow[0, y, x], flow[1, y, x]
                cost = costs[y, x]
                best = cost + _change(flow, y, x, best_x, best_y)
                for down, right in ((0, -step), (-step, 0), (-step, -step), (-step, step)):
                    for far in (1, 2):
                        b, a = y + far * down, x + far * right
                        if b < 0 or b >= rows or a < 0 or a >= columns:
                            continue
                        vx, vy = flow[0, b, a], flow[1, b, a]
                        if abs(vx - best_x) + abs(vy - best_y) < _SAME_PX:
                            continue
                        change = _change(flow, y, x, vx, vy)
                        if change >= best:
                            continue
                        other = _node_cost(pair, noise, y, x, vx, vy)
                        if other + change < best:
                            best, cost, best_x, best_y = other + change, other, vx, vy
                flow[0, y, x], flow[1, y, x] = best_x, best_y
                costs[y, x] = cost


@compiled
def _change(flow: Floats, y: int, x: int, vx: float, vy: float) -> float:
    rows, columns = flow.shape[1:]
    total = 0.0
    for b in range(max(0, y - 1), min(rows, y + 2)):
        for a in range(max(0, x - 1), min(columns, x + 2)):
            total += min(JUMP, STEP * (abs(flow[0, b, a] - vx) + abs(flow[1, b, a] - vy)))
    return total


@compiled
def _node_cost(pair: Singles, noise: float, y: int, x: int, vx: float, vy: float) -> float:
    top, left = NODE_PX * y, NODE_PX * x
    squares, seen = _squares(pair, top, top + NODE_PX, left, left + NODE_PX, vx, vy)
    if seen < NODE_PX**2 / 4:  # as of what is hidden
        return 2 * NODE_PX**2 * noise * MOST_NOISE
    return 2 * NODE_PX**2 * noise * misfit(squares / (seen * noise))


@compiled(fastmath={"reassoc", "contract"})
def sharpen(pair: Singles, noise: float, nodes: Floats, flow: Floats) -> None:
    """Give pixels between nodes of different motion, in place, that of the likeliest of the four.

    `nodes` (2, n, m); `flow` (2, H, W), interpolated between them.
    """
    _, height, width = pair.shape
    _, rows, columns = nodes.shape
    for r in range(height):
        y = (r + 0.5) / NODE_PX - 0.5
        top = min(max(math.floor(y), 0), rows - 1)
        bottom = min(top + 1, rows - 1)
        for c in range(width):
            x = (c + 0.5) / NODE_PX - 0.5
            left = min(max(math.floor(x), 0), columns - 1)
            right = min(left + 1, columns - 1)
            least, most = nodes[:, top, left].copy(), nodes[:, top, left].copy()
            for k in range(2):
                for i, j in ((top, right), (bottom, left), (bottom, right)):
                    least[k] = min(least[k], nodes[k, i, j])
                    most[k] = max(most[k], nodes[k, i, j])
            if max(most[0] - least[0], most[1] - least[1]) < _EDGE_PX:
                continue
            best = np.inf
            for i, j in ((top, left), (top, right), (bottom, left), (bottom, right)):
                vx, vy = nodes[0, i, j], nodes[1, i, j]
                squares, seen = _squares(pair, r - 1, r + 2, c - 1, c + 2, vx, vy)
                cost = 9 * (misfit(squares / (seen * noise)) if seen else 2 * MOST_NOISE)
                cost += _PULL * ((y - i) ** 2 + (x - j) ** 2)
                if cost < best:
                    best = cost
                    flow[0, r, c], flow[1, r, c] = vx, vy


@compiled(fastmath={"reassoc", "contract"})
def _squares(
    pair: Singles, top: int, bottom: int, first: int, last: int, vx: float, vy: float
) -> tuple[float, int]:
    _, height, width = pair.shape
    left, above = math.floor(vx), math.floor(vy)
    a, b = vx - left, vy - above
    total, seen = 0.0, 0
    for r in range(max(0, top, -above), min(height, bottom, height - 1 - above)):
        v = r + above
        for c in range(max(0, first, -left), min(width, last, width - 1 - left)):
            u = c + left
            value = (1 - b) * ((1 - a) * pair[1, v, u] + a * pair[1, v, u + 1]) + b * (
                (1 - a) * pair[1, v + 1, u] + a * pair[1, v + 1, u + 1]
            )
            difference = value - pair[0, r, c]
            total += difference * difference / 2
            seen += 1
    return total, seen
