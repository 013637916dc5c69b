"""Splitting blocks into groups: each block once, with its own error."""

import numpy as np
import pytest

from megalopta.flow.detectors import block_grid
from megalopta.flow.metrics.endpoint_error import block_share, truth_error
from megalopta.flow.metrics.splits import truth_splits


def velocities(seed):
    rng = np.random.default_rng(seed)
    return rng.normal(scale=1.5, size=(4, 10, 12, 2))


def test_groups_share_all_blocks_and_all_errors():
    truth, answer = velocities(0), velocities(1)
    truth[2, 3, 4] = np.nan
    hidden = np.random.default_rng(2).random((4, 10, 12)).round()
    splits, whole = truth_splits(answer, truth, hidden), truth_error(answer, truth)
    for names in (("slow", "medium", "fast"), ("clear", "occlusion")):
        groups = [splits[name] for name in names]
        assert all(group.blocks > 0 for group in groups)
        assert sum(group.blocks for group in groups) == whole.blocks == 4 * 8 * 10 - 1
        total = sum(group.blocks * group.endpoint_error_px for group in groups)
        assert total == pytest.approx(whole.blocks * whole.endpoint_error_px)


@pytest.mark.parametrize(
    ("speed", "name"), [(0.49, "slow"), (0.5, "medium"), (1.99, "medium"), (2.0, "fast")]
)
def test_speed_decides_whatever_the_direction(speed, name):
    truth = np.broadcast_to([0.0, -speed], (1, 5, 5, 2))
    splits = truth_splits(truth, truth, np.zeros((1, 5, 5)))
    assert [each for each in ("slow", "medium", "fast") if splits[each].blocks] == [name]


def test_error_of_occluded_blocks_is_theirs_alone():
    truth = np.ones((1, 5, 5, 2))
    hidden = np.zeros((1, 5, 5))
    hidden[0, 2, 2], hidden[0, 1, 1] = 0.1, 0.09
    answer = truth.copy()
    answer[0, 2, 2, 0] += 3
    splits = truth_splits(answer, truth, hidden)
    assert splits["clear"].endpoint_error_px == 0
    assert splits["occlusion"].endpoint_error_px == 3
    assert splits["occlusion"].blocks == 1


def test_share_of_a_block_is_the_mean_of_the_mask_over_it():
    mask = np.random.default_rng(3).random((2, 40, 60)) < 0.3
    grid = block_grid((20, 30), 4)
    shares = block_share(mask, grid)
    # Blocks of 4 px in the half-sized image are 8 px here; 30 columns leave a margin of 1, so 2.
    blocks = mask[:, :, 2:58].reshape(2, 5, 8, 7, 8)
    np.testing.assert_allclose(shares, blocks.mean(axis=(2, 4)), rtol=1e-12)
