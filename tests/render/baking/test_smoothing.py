"""Clusters that share their light: what is gained where light is even, and kept where it is not."""

import numpy as np
import pytest

from megalopta.render.baking.clusters import Clusters, smoothed

RNG = np.random.default_rng(5)
GROUPS, SIZE, RAYS = 400, 20, 16
NEIGHBORS = np.repeat(np.arange(GROUPS, dtype=np.uint64), SIZE)
EVEN = np.full(GROUPS * SIZE, RAYS)
SEEN = np.full(GROUPS * SIZE, 3)


def measured(truth, sigma):
    """Rows of one value whose halves have the error σ·√2 each."""
    halves = truth[:, None] + RNG.normal(0, sigma * np.sqrt(2), (len(truth), 2))
    return np.stack([halves.mean(axis=1), (halves[:, 0] - halves[:, 1]) / 2], axis=1)


@pytest.mark.parametrize("contrast", [0.0, 0.3, 1.0, 10.0])
def test_what_is_left_is_the_least_error_of_a_known_contrast(contrast):
    truth = 5 + RNG.normal(0, contrast, GROUPS * SIZE)
    better = smoothed(measured(truth, 1.0), NEIGHBORS, EVEN, SEEN)
    # Of the noise 1 and the contrast τ² the part τ²/(τ² + 1) is left, and 1/20 of the rest, the
    # noise of the mean; contrasts known from 20 values add up to a tenth of the noise.
    kept = contrast**2 / (contrast**2 + 1)
    least = kept + (1 - kept) / SIZE
    assert least - 0.05 < np.mean((better[:, 0] - truth) ** 2) < least + 0.12


@pytest.mark.parametrize("contrast", [0.5, 1.0, 3.0])
def test_half_differences_tell_the_error_that_is_left_with_what_is_taken_of_contrast(contrast):
    truth = 5 + RNG.normal(0, contrast, GROUPS * SIZE)
    better = smoothed(measured(truth, 1.0), NEIGHBORS, EVEN, SEEN)
    left = np.mean((better[:, 0] - truth) ** 2)
    # The shares that are kept are known from 20 values: what is left is more than it could be.
    assert 0.65 * left < np.mean(better[:, 1] ** 2) < 1.05 * left


def test_a_cluster_without_neighbors_is_left_alone():
    rows = measured(np.arange(5.0), 1.0)
    np.testing.assert_array_equal(
        smoothed(rows, np.arange(5, dtype=np.uint64), EVEN[:5], SEEN[:5]), rows
    )


def test_clusters_draw_their_cells_as_often_as_they_were_seen():
    cell = np.array([3, 5, 8, 9, 12], np.uint32)
    keys = np.array([7, 2, 7, 2, 1], np.uint64)
    seen, places = np.array([3, 1, 1, 7, 2], np.uint32), cell + 100
    clusters = Clusters.of(cell, keys, seen, places)
    assert len(clusters) == 3
    np.testing.assert_array_equal(clusters.leaders, [12, 5, 3])
    np.testing.assert_array_equal(clusters.seen, [2, 8, 4])
    drawn, where = clusters.draws(np.array([2, 1]))
    assert drawn.shape == (2, 32)
    np.testing.assert_array_equal(where, drawn + 100)
    assert [np.sum(drawn[0] == each) for each in (3, 8)] == [24, 8]
    assert [np.sum(drawn[1] == each) for each in (5, 9)] == [4, 28]
    members, owner = clusters.of_members(np.array([1, 0]))
    np.testing.assert_array_equal(members, [5, 9, 12])
    np.testing.assert_array_equal(owner, [0, 0, 1])
