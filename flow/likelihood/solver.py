"""The sparse system of nodes: conjugate gradients, preconditioned by multigrid.

On a coarser grid, velocities of squares of 2 × 2 nodes change together: their information adds up,
and so do the weights of links between squares (Braess 1995, with symmetric Gauss-Seidel smoothing).
All grids lie one below the other in one array, each with a border of nodes without links.
"""

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled

_MOST_ITERATIONS = 500


@compiled
def _grids(rows: int, columns: int) -> NDArray[np.intp]:
    """Return the first row, rows and columns of each grid, without its border."""
    grids = [(1, rows, columns)]
    while rows * columns > 1:
        top = grids[-1][0] + rows + 2
        rows, columns = (rows + 1) // 2, (columns + 1) // 2
        grids.append((top, rows, columns))
    return np.array(grids)


@compiled(fastmath={"reassoc", "contract"})
def improve(matrix: Floats, slope: Floats, velocities: Floats, most_error: float) -> None:
    """Change velocities (2, n, m) to those that minimize ½Σuᵀ·A·u − bᵀ·u + ½Σw·|u − u'|².

    Ends where the energy is at most about `most_error` above the least.

    `matrix` (5, n, m): xx, xy, yy of A of each node, weights w of its links to the right, 0 in the
    last column, and downward, 0 in the last row; `slope` (2, n, m): b.
    """
    _, rows, columns = velocities.shape
    grids = _grids(rows, columns)
    last = grids[-1, 0] + 2
    on_grids = np.zeros((5, last, columns + 2))
    on_grids[:, 1 : rows + 1, 1 : columns + 1] = matrix
    for k in range(len(grids) - 1):
        _add_up(on_grids, grids[k], grids[k + 1])
    diagonal = np.zeros((3, rows + 2, columns + 2))
    for y in range(1, last):
        for x in range(1, columns + 1):
            pull = on_grids[3, y, x - 1] + on_grids[3, y, x]
            pull += on_grids[4, y - 1, x] + on_grids[4, y, x]
            xx, xy, yy = on_grids[0, y, x] + pull, on_grids[1, y, x], on_grids[2, y, x] + pull
            if y <= rows:
                diagonal[0, y, x], diagonal[1, y, x], diagonal[2, y, x] = xx, xy, yy
            determinant = xx * yy - xy * xy
            if determinant > 0:
                on_grids[0, y, x] = yy / determinant
                on_grids[1, y, x] = -xy / determinant
                on_grids[2, y, x] = xx / determinant
    residual, change = np.zeros((2, 2, last, columns + 2))
    direction, pushed = np.zeros((2, 2, rows + 2, columns + 2))
    inner = (slice(None), slice(1, rows + 1), slice(1, columns + 1))
    direction[inner] = velocities
    _push(diagonal, on_grids, direction, pushed)
    residual[inner] = slope - pushed[inner]
    error = np.inf
    for _ in range(_MOST_ITERATIONS):
        before = error
        _cycle(on_grids, grids, residual, change)
        error = 0.0
        for k in range(2):
            for y in range(1, rows + 1):
                for x in range(1, columns + 1):
                    error += residual[k, y, x] * change[k, y, x]
        if not error > 2 * most_error:
            break
        keep = error / before
        for k in range(2):
            for y in range(1, rows + 1):
                for x in range(1, columns + 1):
                    direction[k, y, x] = change[k, y, x] + keep * direction[k, y, x]
        step = error / _push(diagonal, on_grids, direction, pushed)
        for k in range(2):
            for y in range(rows):
                for x in range(columns):
                    velocities[k, y, x] += step * direction[k, y + 1, x + 1]
                    residual[k, y + 1, x + 1] -= step * pushed[k, y + 1, x + 1]


@compiled(fastmath={"reassoc", "contract"})
def _add_up(on_grids: Floats, fine: NDArray[np.intp], coarse: NDArray[np.intp]) -> None:
    """Add the information of nodes to that of squares, and weights of links between squares."""
    top, rows, columns = fine
    for y in range(rows):
        for x in range(columns):
            row, column = coarse[0] + y // 2, 1 + x // 2
            for k in range(3):
                on_grids[k, row, column] += on_grids[k, top + y, 1 + x]
            if x % 2:
                on_grids[3, row, column] += on_grids[3, top + y, 1 + x]
            if y % 2:
                on_grids[4, row, column] += on_grids[4, top + y, 1 + x]


@compiled(fastmath={"reassoc", "contract"})
def _push(diagonal: Floats, on_grids: Floats, direction: Floats, pushed: Floats) -> float:
    """Write the product of the matrix and a direction; return their scalar product."""
    _, rows, columns = direction.shape
    product = 0.0
    for k in range(2):
        for y in range(1, rows - 1):
            for x in range(1, columns - 1):
                force = diagonal[2 * k, y, x] * direction[k, y, x]
                force += diagonal[1, y, x] * direction[1 - k, y, x]
                force -= on_grids[3, y, x - 1] * direction[k, y, x - 1]
                force -= on_grids[3, y, x] * direction[k, y, x + 1]
                force -= on_grids[4, y - 1, x] * direction[k, y - 1, x]
                force -= on_grids[4, y, x] * direction[k, y + 1, x]
                pushed[k, y, x] = force
                product += force * direction[k, y, x]
    return product


@compiled(fastmath={"reassoc", "contract"})
def _cycle(on_grids: Floats, grids: NDArray[np.intp], residual: Floats, change: Floats) -> None:
    """Write the change of velocities by one cycle over all grids, from fine to coarse and back."""
    xx, xy, yy, right, down = on_grids
    for k in range(len(grids)):
        top, rows, columns = grids[k]
        if k:
            residual[:, top : top + rows, 1 : columns + 1] = 0
            _, finer_rows, finer_columns = grids[k - 1]
            start = grids[k - 1, 0]
            for y in range(finer_rows):
                i = start + y
                for x in range(finer_columns):
                    j = 1 + x
                    for c in range(2):
                        # what the sweep from the top left leaves to neighbors after it
                        left = right[i, j] * change[c, i, j + 1] + down[i, j] * change[c, i + 1, j]
                        residual[c, top + y // 2, 1 + x // 2] += left
        for i in range(top, top + rows):
            for j in range(1, columns + 1):
                x, y = residual[0, i, j], residual[1, i, j]
                x += right[i, j - 1] * change[0, i, j - 1] + down[i - 1, j] * change[0, i - 1, j]
                y += right[i, j - 1] * change[1, i, j - 1] + down[i - 1, j] * change[1, i - 1, j]
                change[0, i, j] = xx[i, j] * x + xy[i, j] * y
                change[1, i, j] = xy[i, j] * x + yy[i, j] * y
    for k in range(len(grids) - 2, -1, -1):
        top, rows, columns = grids[k]
        below = grids[k + 1, 0]
        for y in range(rows):
            for x in range(columns):
                for c in range(2):
                    change[c, top + y, 1 + x] += change[c, below + y // 2, 1 + x // 2]
        for i in range(top + rows - 1, top - 1, -1):
            for j in range(columns, 0, -1):
                x, y = residual[0, i, j], residual[1, i, j]
                x += right[i, j - 1] * change[0, i, j - 1] + down[i - 1, j] * change[0, i - 1, j]
                y += right[i, j - 1] * change[1, i, j - 1] + down[i - 1, j] * change[1, i - 1, j]
                x += right[i, j] * change[0, i, j + 1] + down[i, j] * change[0, i + 1, j]
                y += right[i, j] * change[1, i, j + 1] + down[i, j] * change[1, i + 1, j]
                change[0, i, j] = xx[i, j] * x + xy[i, j] * y
                change[1, i, j] = xy[i, j] * x + yy[i, j] * y
