"""The linear system of evidence and smoothness."""

import numpy as np
import pytest

from megalopta.flow.likelihood import most_likely


def test_system_of_nodes_is_solved_as_a_dense_matrix_would_be():
    rng = np.random.default_rng(0)
    n, m = 3, 4
    roots = rng.normal(size=(2, 2, n, m))
    xx, xy, yy = (
        np.einsum("knm,knm->nm", roots[:, i], roots[:, j]) for i, j in ((0, 0), (0, 1), (1, 1))
    )
    slope = rng.normal(size=(2, n, m))
    right, down = rng.random((n, m - 1)), rng.random((n - 1, m))

    def energy(u):
        u = u.reshape(2, n, m)
        evidence = xx * u[0] ** 2 + 2 * xy * u[0] * u[1] + yy * u[1] ** 2
        links = (right * np.diff(u, axis=2) ** 2).sum() + (down * np.diff(u, axis=1) ** 2).sum()
        return (evidence.sum() + links) / 2 - (slope * u).sum()

    found = most_likely(np.stack((xx, xy, yy)), slope, (right, down)).ravel()
    # a quadratic form has equal, higher values on both sides of its minimum, along every axis
    for step in 0.1 * np.eye(found.size):
        assert energy(found + step) == pytest.approx(energy(found - step), abs=1e-6)
        assert energy(found + step) > energy(found)


def test_nodes_without_evidence_lie_on_a_line_between_those_that_have_it():
    information, slope = np.zeros((3, 1, 5)), np.zeros((2, 1, 5))
    information[[0, 2], :, ::4] = 1e9
    slope[0, 0, 4] = 8e9
    found = most_likely(information, slope, (np.ones((1, 4)), np.ones((0, 5))))
    np.testing.assert_allclose(found[0, 0], (0, 2, 4, 6, 8), atol=1e-5)
    np.testing.assert_allclose(found[1, 0], 0, atol=1e-5)
