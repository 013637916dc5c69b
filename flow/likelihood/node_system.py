"""The flow at the nodes of a grid that evidence and smoothness together make most likely.

Each node has evidence, a quadratic form of its velocity, and a spring to each of its four
neighbors. The least of the sum solves a sparse symmetric system of two unknowns a node, by
factorization, so that evidence reaches any distance in one step.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

from megalopta.core.arrays import Floats

_LEAST = 1e-9
"""Evidence for the velocity 0 at every node, so that there is an answer without photons"""


def most_likely(information: Floats, slope: Floats, springs: tuple[Floats, Floats]) -> Floats:
    """Return the velocities u, (2, n, m), of least ½Σuᵀ·A·u − bᵀ·u + ½Σw·|u − u'|².

    Parameters
    ----------
    information : (3, n, m)
        A of each node: xx, xy, yy.
    slope : (2, n, m)
        b of each node.
    springs : (n, m − 1) and (n − 1, m)
        w to the right neighbor, and to the lower.
    """
    shape = slope.shape[1:]
    nodes = int(np.prod(shape))
    first, second = links(shape)
    stiffness = np.concatenate([spring.ravel() for spring in springs])
    ends = np.concatenate((first, second))
    pull = np.bincount(ends, np.concatenate((stiffness, stiffness)), nodes) + _LEAST
    xx, xy, yy = information.reshape(3, nodes)
    x = np.arange(nodes)
    y = x + nodes
    # (row, column, value) of every entry
    entries = [(x, x, xx + pull), (y, y, yy + pull), (x, y, xy), (y, x, xy)]
    for offset in (0, nodes):
        entries.append((first + offset, second + offset, -stiffness))
        entries.append((second + offset, first + offset, -stiffness))
    rows, columns, values = (np.concatenate(each) for each in zip(*entries, strict=True))
    matrix = coo_array((values, (rows, columns)), shape=(2 * nodes, 2 * nodes)).tocsc()
    factors = splu(matrix, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    return np.asarray(factors.solve(slope.ravel())).reshape(2, *shape)


def links(shape: tuple[int, ...]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return both nodes of all links of a grid, (links,) each: to the right, then downward."""
    index = np.arange(int(np.prod(shape))).reshape(shape)
    first = np.concatenate((index[:, :-1].ravel(), index[:-1].ravel()))
    second = np.concatenate((index[:, 1:].ravel(), index[1:].ravel()))
    return first, second
