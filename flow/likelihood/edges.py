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
    _, rows, columns = flow.shape
    costs = np.empty((rows, columns), np.float32)
    for y, x in np.ndindex(costs.shape):
        costs[y, x] = _node_cost(pair, noise, y, x, flow[0, y, x], flow[1, y, x])
    for sweep in range(_SWEEPS):
        step = 1 - 2 * (sweep % 2)
        for y in np.arange(rows)[::step]:
            for x in np.arange(columns)[::step]:
                best_x, best_y = flow[:, y, x]
                best = costs[y, x] + _change(flow, y, x, best_x, best_y)
                for down, right in ((0, -step), (-step, 0), (-step, -step), (-step, step)):
                    for far in (1, 2):
                        i, j = y + far * down, x + far * right
                        if not (0 <= i < rows and 0 <= j < columns):
                            continue
                        vx, vy = flow[:, i, j]
                        if abs(vx - best_x) + abs(vy - best_y) < _SAME_PX:
                            continue
                        change = _change(flow, y, x, vx, vy)
                        if change >= best:
                            continue
                        cost = _node_cost(pair, noise, y, x, vx, vy)
                        if cost + change < best:
                            best, best_x, best_y = cost + change, vx, vy
                            costs[y, x] = cost
                flow[0, y, x], flow[1, y, x] = best_x, best_y


@compiled
def _change(flow: Floats, y: int, x: int, vx: float, vy: float) -> float:
    """Return the cost of how a motion of a node differs from those of its neighbors."""
    _, rows, columns = flow.shape
    total = 0.0
    for i in range(max(0, y - 1), min(rows, y + 2)):
        for j in range(max(0, x - 1), min(columns, x + 2)):
            total += min(JUMP, STEP * (abs(flow[0, i, j] - vx) + abs(flow[1, i, j] - vy)))
    return total


@compiled
def _node_cost(pair: Singles, noise: float, y: int, x: int, vx: float, vy: float) -> float:
    square, seen = _square(pair, NODE_PX * y, NODE_PX * x, NODE_PX, vx, vy)
    is_hidden = seen < NODE_PX**2 / 4
    return 2 * NODE_PX**2 * noise * (MOST_NOISE if is_hidden else misfit(square / noise))


@compiled(fastmath={"reassoc", "contract"})
def sharpen(pair: Singles, noise: float, nodes: Floats, flow: Floats) -> None:
    """Give pixels between nodes of different motion, in place, that of the likeliest of the four.

    `nodes` (2, n, m); `flow` (2, H, W), interpolated between them.
    """
    (_, rows, columns), (_, height, width) = nodes.shape, flow.shape
    half = NODE_PX // 2
    for top in range(rows):
        for left in range(columns):
            vx, vy = nodes[:, top : top + 2, left : left + 2]
            if max(vx.max() - vx.min(), vy.max() - vy.min()) < _EDGE_PX:
                continue
            # the pixels between these nodes, and those before the first
            last_row, last_column = NODE_PX * (top + 1) + half, NODE_PX * (left + 1) + half
            for r in range(NODE_PX * top + half if top else 0, min(height, last_row)):
                for c in range(NODE_PX * left + half if left else 0, min(width, last_column)):
                    best = np.inf
                    for i, j in np.ndindex(vx.shape):
                        y, x = NODE_PX * (top + i + 0.5), NODE_PX * (left + j + 0.5)
                        square, seen = _square(pair, r - 1, c - 1, 3, vx[i, j], vy[i, j])
                        cost = 9 * (misfit(square / noise) if seen else 2 * MOST_NOISE)
                        cost += _PULL * ((r + 0.5 - y) ** 2 + (c + 0.5 - x) ** 2) / NODE_PX**2
                        if cost < best:
                            best, flow[0, r, c], flow[1, r, c] = cost, vx[i, j], vy[i, j]


@compiled(fastmath={"reassoc", "contract"})
def _square(
    pair: Singles, top: int, left: int, side: int, vx: float, vy: float
) -> tuple[float, int]:
    """Return half the mean squared difference of a square from where it moved to, and its pixels.

    Those count that are in both frames.
    """
    _, height, width = pair.shape
    right, down = math.floor(vx), math.floor(vy)
    a, b = vx - right, vy - down
    total, seen = 0.0, 0
    for r in range(max(0, top, -down), min(height, top + side, height - 1 - down)):
        for c in range(max(0, left, -right), min(width, left + side, width - 1 - right)):
            y, x = r + down, c + right
            above = (1 - a) * pair[1, y, x] + a * pair[1, y, x + 1]
            below = (1 - a) * pair[1, y + 1, x] + a * pair[1, y + 1, x + 1]
            total += ((1 - b) * above + b * below - pair[0, r, c]) ** 2 / 2
            seen += 1
    return total / max(seen, 1), seen
