"""Covariances of nodes, against the inverse of the whole matrix."""

import numpy as np
import pytest

from megalopta.flow.likelihood import MostLikely
from megalopta.flow.likely_flow import node_covariance


@pytest.mark.parametrize("shape", [(3, 5), (5, 3), (1, 4)])
def test_covariances_are_blocks_of_the_inverse(shape):
    """A column of the inverse solves the system for a unit slope, by other code."""
    rng = np.random.default_rng(0)
    roots = rng.normal(size=(2, 2, *shape))
    information = np.stack(
        [(roots[:, i] * roots[:, j]).sum(0) for i, j in ((0, 0), (0, 1), (1, 1))]
    )
    rows, columns = shape
    springs = rng.random((rows, columns - 1)), rng.random((rows - 1, columns))
    found = node_covariance(information, springs)
    for place in np.ndindex(shape):
        for axis in range(2):
            slope = np.zeros((2, *shape))
            slope[(axis, *place)] = 1
            solved = MostLikely()(information, slope, springs, slope)[(slice(None), *place)]
            # `MostLikely` adds 1e-9 to the diagonal
            np.testing.assert_allclose(found[(slice(axis, axis + 2), *place)], solved, rtol=1e-6)
