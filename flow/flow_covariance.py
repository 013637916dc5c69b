"""The covariance of a flow at nodes: the inverse of its information, where it is found.

At the most likely flow, evidence and prior are a quadratic form with the matrix A + P: A has a
block of 2 × 2 per node, the information, P ties neighbors. The blocks on the diagonal of the
inverse are the covariances of nodes (Laplace's approximation). A row of nodes is tied to the rows
beside it alone, so the matrix is block tridiagonal, and these blocks of its inverse follow exactly
from two passes, one down and one up (Takahashi's equations).
"""

import numpy as np

from megalopta.core.arrays import Floats


def node_covariance(information: Floats, springs: tuple[Floats, Floats]) -> Floats:
    """Return the covariances (3, n, m) of nodes, px²: xx, xy, yy.

    As for `likelihood.MostLikely`: `information` (3, n, m), and `springs` (n, m − 1), (n − 1, m)
    to the right neighbor and to the lower. Some node must have information.
    """
    is_wide = information.shape[1] < information.shape[2]
    if is_wide:  # blocks of the shorter side
        right, below = springs
        found = node_covariance(information.transpose(0, 2, 1), (below.T, right.T))
        return found.transpose(0, 2, 1)
    rows = information.shape[1]
    down = np.pad(np.tile(springs[1], 2), ((1, 1), (0, 0)))  # of both components
    # inverse of each row, given all above
    above: list[Floats] = []
    for row in range(rows):
        block = _row(information[:, row], springs[0][row], down[row] + down[row + 1])
        if row:
            block -= down[row][:, np.newaxis] * above[-1] * down[row]
        above.append(np.asarray(np.linalg.inv(block), np.float64))
    found, last = np.empty_like(information), above[-1]
    found[:, -1] = _blocks(last)
    for row in range(rows - 2, -1, -1):
        tied = above[row] * down[row + 1]
        last = np.asarray(above[row] + tied @ last @ tied.T)
        found[:, row] = _blocks(last)
    return found


def _row(information: Floats, right: Floats, vertical: Floats) -> Floats:
    """Return the matrix (2m, 2m) of a row, x of all nodes before y."""
    xx, xy, yy = information
    width = len(xx)
    pull = np.pad(right, (1, 0)) + np.pad(right, (0, 1))
    matrix = np.diag(np.concatenate((xx + pull, yy + pull)) + vertical)
    node = np.arange(width)
    matrix[node, node + width] = matrix[node + width, node] = xy
    for first in (node[:-1], node[:-1] + width):
        matrix[first, first + 1] = matrix[first + 1, first] = -right
    return np.asarray(matrix)


def _blocks(inverse: Floats) -> Floats:
    """Return xx, xy, yy of the nodes of a row, (3, m), from its matrix (2m, 2m)."""
    width = len(inverse) // 2
    diagonal = np.diag(inverse)
    return np.stack((diagonal[:width], np.diag(inverse, width), diagonal[width:]))
