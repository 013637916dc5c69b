"""Clusters that share their light: what is gained where light is even, and kept where it is not."""

import numpy as np
import pytest

from megalopta.render.baking.smoothing import smoothed

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
