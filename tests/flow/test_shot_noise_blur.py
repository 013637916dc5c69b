import numpy as np
import pytest

from megalopta.flow.blocks import block_grid
from megalopta.flow.shot_noise_blur import BLURS_PX, block_moments, blur_levels


def moments(dispersion, pixels=1000.0, mean=2.0):
    """Sums of counts whose variance is `dispersion` times their mean."""
    return np.array([pixels, pixels * mean, pixels * (dispersion * mean + mean**2)])


def test_moments_are_sums_over_blocks_and_margins_inside_the_frame():
    counts = np.random.default_rng(1).poisson(3, (50, 64)).astype(np.float32)
    sums = block_moments(counts, block_grid((50, 64), 15), 4)
    assert sums.shape == (3, 3, 4)
    corner, middle = counts[:21, :21].astype(float), counts[13:36, 13:36].astype(float)
    for block, cut in (((0, 0), corner), ((1, 1), middle)):
        expected = (cut.size, cut.sum(), (cut**2).sum())
        np.testing.assert_allclose(sums[:, block[0], block[1]], expected)


def test_blur_falls_as_texture_rises_over_shot_noise():
    levels = [int(blur_levels(moments(1 + q), 2)) for q in (0.0, 0.03, 0.08, 0.25, 1.0, 100.0)]
    assert [BLURS_PX[level] for level in levels] == [2.0, 2.0, 1.4, 1.0, 0.7, 0.7]


def test_four_times_the_frames_count_as_four_times_the_texture():
    for q in np.geomspace(0.01, 1, 20):
        assert blur_levels(moments(1 + q), 8) == blur_levels(moments(1 + 4 * q), 2)


@pytest.mark.parametrize("sums", [[100.0, 0.0, 0.0], [100.0, 200.0, 600.0]])
def test_darkness_and_pure_shot_noise_get_the_widest_blur(sums):
    assert blur_levels(np.array(sums), 2) == len(BLURS_PX) - 1
