import numpy as np
import pytest

from megalopta.flow.detectors.blocks import BlockGrid, between_blocks, block_grid, block_sums
from megalopta.flow.detectors.registry import METHODS


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


@pytest.mark.parametrize(
    ("shape", "block", "sentence"),
    [
        ((9, 60), None, "blocks of 2 px: give frames of 20 px or more"),
        ((60, 60), 1, "3 × 3 blocks"),
        ((60, 60), 21, "3 × 3 blocks"),
    ],
)
def test_too_few_or_too_small_blocks_are_refused(shape, block, sentence):
    with pytest.raises(ValueError, match=sentence):
        block_grid(shape, block)


@pytest.mark.parametrize(("name", "most"), [("BM", 2), ("DIS", 2), ("PPM", 8), ("BA", 8)])
def test_a_method_refuses_more_frames_than_it_takes_together(name, most):
    frames = np.random.default_rng(0).poisson(9, (9, 40, 50))
    assert METHODS[name].dense(*frames[:most]).shape == (40, 50, 2)
    with pytest.raises(ValueError, match=f"9 frames: {name} takes 2"):
        METHODS[name].dense(*frames)
    with pytest.raises(ValueError, match="1 frames"):
        METHODS[name].dense(frames[0])


def test_between_blocks_velocities_are_linear_and_where_there_is_none_undefined():
    grid = BlockGrid((22, 30), 5)  # 4 × 6 blocks, one row of pixels above them
    x, y = np.moveaxis(grid.centers, -1, 0)
    flow = between_blocks(np.stack((2 * x - y, y), axis=-1), grid)
    rows, columns = (np.mgrid[:22, :30] + 0.5)[:, 4:18, 3:27]
    np.testing.assert_allclose(flow[4:18, 3:27, 0], 2 * columns - rows, atol=1e-12)
    np.testing.assert_allclose(flow[4:18, 3:27, 1], rows, atol=1e-12)
    np.testing.assert_allclose(flow[0], flow[3], atol=1e-12)
    holed = np.ones((4, 6, 2))
    holed[1, 2] = np.nan
    undefined = np.isnan(between_blocks(holed, grid)).any(axis=-1)
    assert undefined.sum() == 25 and undefined[6:11, 10:15].all()
    assert np.isnan(between_blocks(np.full((4, 6, 2), np.nan), grid)).all()
