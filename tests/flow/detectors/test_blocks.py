import numpy as np
import pytest

from megalopta.flow.detectors.blocks import block_grid, block_sums


@pytest.mark.parametrize("size", [60, 120, 180, 240])
def test_thesis_frames_have_a_hundred_blocks(size):
    grid = block_grid((size, size))
    assert (grid.rows, grid.columns, grid.block_px) == (10, 10, size // 10)
    assert (grid.top, grid.left) == (0, 0)


def test_block_sums_add_up_the_covered_part():
    image = np.random.default_rng(0).random((31, 47))
    grid = block_grid((31, 47), 4)
    covered = image[grid.top : grid.top + 28, grid.left : grid.left + 44]
    sums = block_sums(image, grid)
    assert sums.shape == (7, 11)
    np.testing.assert_allclose(sums.sum(), covered.sum())
    np.testing.assert_allclose(sums[2, 3], covered[8:12, 12:16].sum())


@pytest.mark.parametrize(("shape", "block"), [((19, 60), None), ((60, 60), 1), ((60, 60), 21)])
def test_too_few_or_too_small_blocks_are_refused(shape, block):
    with pytest.raises(ValueError, match="3 × 3 blocks"):
        block_grid(shape, block)


def test_the_message_names_a_size_that_is_enough():
    with pytest.raises(ValueError, match="blocks of 2 px: give frames of 20 px or more"):
        block_grid((9, 60))
    assert block_grid((20, 60)).block_px == 2
