"""The sparse system of nodes: conjugate gradients, preconditioned by multigrid.

On a coarser grid, velocities of squares of 2 × 2 nodes change together: their information adds up,
and so do the weights of links between squares (Braess 1995, with symmetric Gauss-Seidel smoothing).
All grids lie one below the other in one array, each with a border of nodes without links.
"""

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled

Grid = tuple[int, int, int]
"""First row in the array, rows and columns of nodes"""


@compiled(fastmath={"reassoc", "contract"})
def improve(matrix: Floats, slope: Floats, velocities: Floats, most_error: float) -> None:
    """Change velocities (2, n, m) to those that minimize ½Σuᵀ·A·u − bᵀ·u + ½Σw·|u − u'|².

    Ends where this sum is at most about `most_error` above the least.

    `matrix` (5, n, m): xx, xy, yy of A of each node, weights w of its links to the right, 0 in the
    last column, and downward, 0 in the last row; `slope` (2, n, m): b.
    """
    _, rows, columns = velocities.shape
    grids = [(1, rows, columns)]
    while grids[-1][1] * grids[-1][2] > 1:
        top, height, width = grids[-1]
        grids.append((top + height + 2, (height + 1) // 2, (width + 1) // 2))
    grids.append((grids[-1][0] + 3, 1, 1))  # takes what the coarsest passes on
    # xx, xy, yy, and weights to the right and downward; then the inverse of each node's xx, xy, yy
    system = np.zeros((8, grids[-1][0] + 2, columns + 2))
    system[:5, 1 : rows + 1, 1 : columns + 1] = matrix
    for k in range(len(grids) - 1):
        top, height, width = grids[k]
        for y in range(top, top + height):
            for x in range(1, width + 1):
                square, column = grids[k + 1][0] + (y - top) // 2, (x + 1) // 2
                for part in range(5):  # links within a square do not count
                    if (part != 3 or x % 2 == 0) and (part != 4 or (y - top) % 2 == 1):
                        system[part, square, column] += system[part, y, x]
                pull = system[3, y, x - 1] + system[3, y, x] + system[4, y - 1, x] + system[4, y, x]
                xx, xy, yy = system[0, y, x] + pull, system[1, y, x], system[2, y, x] + pull
                system[0, y, x], system[2, y, x] = xx, yy
                determinant = xx * yy - xy**2
                system[5, y, x], system[7, y, x] = yy / determinant, xx / determinant
                system[6, y, x] = -xy / determinant
    residual = np.zeros((2, *system.shape[1:]))
    change = np.zeros_like(residual)
    direction = np.zeros((2, rows + 2, columns + 2))
    pushed = np.zeros_like(direction)
    fine, inner = residual[:, : rows + 2], (slice(None), slice(1, rows + 1), slice(1, columns + 1))
    direction[inner] = velocities
    _push(system, direction, pushed)
    residual[inner] = slope - pushed[inner]
    error = np.inf
    for _ in range(500):  # most iterations
        _cycle(system, grids, residual, change)
        before, error = error, (fine * change[:, : rows + 2]).sum()
        if not error > 2 * most_error:
            break
        direction *= error / before
        direction += change[:, : rows + 2]
        _push(system, direction, pushed)
        step = error / (direction * pushed).sum()
        velocities += step * direction[inner]
        fine -= step * pushed


@compiled(fastmath={"reassoc", "contract"})
def _push(system: Floats, velocities: Floats, pushed: Floats) -> None:
    """Write the product of the matrix of nodes and velocities."""
    for k in range(2):
        along, across = velocities[k], velocities[1 - k]
        for y in range(1, along.shape[0] - 1):
            for x in range(1, along.shape[1] - 1):
                force = system[2 * k, y, x] * along[y, x] + system[1, y, x] * across[y, x]
                pushed[k, y, x] = force - _pull(system, along, y, x)


@compiled(fastmath={"reassoc", "contract"})
def _pull(system: Floats, component: Floats, y: int, x: int) -> float:
    """Return the sum of velocities of neighbors times the weights of their links."""
    beside = system[3, y, x - 1] * component[y, x - 1] + system[3, y, x] * component[y, x + 1]
    beyond = system[4, y - 1, x] * component[y - 1, x] + system[4, y, x] * component[y + 1, x]
    return float(beside + beyond)


@compiled(fastmath={"reassoc", "contract"})
def _cycle(system: Floats, grids: list[Grid], residual: Floats, change: Floats) -> None:
    """Write the change of velocities by one cycle over all grids, from fine to coarse and back."""
    change[:] = 0
    for k in range(len(grids) - 1):
        top, rows, columns = grids[k]
        for color in range(2):  # of a chessboard
            _relax(system, residual, change, grids[k], color)
        below = grids[k + 1][0]
        residual[:, below : below + (rows + 1) // 2] = 0
        for component in range(2):
            for y in range(top, top + rows):  # the other color changed last
                for x in range(1 + y % 2, columns + 1, 2):
                    left = _pull(system, change[component], y, x)
                    residual[component, below + (y - top) // 2, (x + 1) // 2] += left
    for k in range(len(grids) - 3, -1, -1):
        top, rows, columns = grids[k]
        for component in range(2):
            for i in range(rows):
                for x in range(1, columns + 1):
                    square = change[component, grids[k + 1][0] + i // 2, (x + 1) // 2]
                    change[component, top + i, x] += square
        for color in range(1, -1, -1):
            _relax(system, residual, change, grids[k], color)


@compiled(fastmath={"reassoc", "contract"})
def _relax(system: Floats, residual: Floats, change: Floats, grid: Grid, color: int) -> None:
    """Give nodes of a color the changes that their neighbors ask for."""
    top, rows, columns = grid
    for y in range(top, top + rows):
        for x in range(1 + (y + color) % 2, columns + 1, 2):
            right = residual[0, y, x] + _pull(system, change[0], y, x)
            down = residual[1, y, x] + _pull(system, change[1], y, x)
            change[0, y, x] = system[5, y, x] * right + system[6, y, x] * down
            change[1, y, x] = system[6, y, x] * right + system[7, y, x] * down
