import numpy as np
import pytest

from megalopta.flow.detectors.blocks import block_grid
from megalopta.flow.detectors.shot_noise_blur import (
    BLURS_PX,
    SmoothedFrame,
    block_moments,
    blur_levels,
)


def moments(dispersion, pixels=1000.0, mean=2.0):
    """Sums of counts whose variance is `dispersion` times their mean."""
    return np.array([pixels, pixels * mean, pixels * (dispersion * mean + mean**2)])


def level(dispersion, frames):
    return int(blur_levels(moments(dispersion), frames))


def test_moments_are_sums_over_blocks_and_margins_inside_the_frame():
    counts = np.random.default_rng(1).poisson(3, (50, 64)).astype(np.float32)
    sums = block_moments(counts, block_grid((50, 64), 15), 4)
    assert sums.shape == (3, 3, 4)
    corner, middle = counts[:21, :21].astype(float), counts[13:36, 13:36].astype(float)
    for block, cut in (((0, 0), corner), ((1, 1), middle)):
        expected = (cut.size, cut.sum(), (cut**2).sum())
        np.testing.assert_allclose(sums[:, block[0], block[1]], expected)


def test_blur_falls_as_texture_rises_over_shot_noise():
    levels = [level(1 + q, 2) for q in (0.0, 0.03, 0.08, 0.25, 1.0, 100.0)]
    assert [BLURS_PX[level] for level in levels] == [2.0, 2.0, 1.4, 1.0, 0.7, 0.7]


def test_four_times_the_frames_count_as_four_times_the_texture():
    for q in np.geomspace(0.01, 1, 20):
        assert level(1 + q, 8) == level(1 + 4 * q, 2)


@pytest.mark.parametrize("sums", [[100.0, 0.0, 0.0], [100.0, 200.0, 600.0]])
def test_darkness_and_pure_shot_noise_get_the_widest_blur(sums):
    assert blur_levels(np.array(sums), 2) == len(BLURS_PX) - 1


@pytest.mark.parametrize("level", range(len(BLURS_PX)))
def test_noise_of_the_roots_is_the_same_in_the_dark_and_in_the_light(level):
    impulse = np.zeros((31, 31))
    impulse[15, 15] = 1
    weights = SmoothedFrame(impulse).roots(level) ** 2
    for mean in (5, 500):
        counts = np.random.default_rng(level).poisson(mean, (300, 300))
        variance = SmoothedFrame(counts).roots(level)[10:-10, 10:-10].var()
        # A quarter of what the smoothing leaves of a variance equal to the mean; a mean of 5 makes
        # it 2 % more, and 280² pixels with 50 in common leave an error of 3 %: five of those.
        assert variance == pytest.approx(0.25 * (weights**2).sum(), rel=0.17)


@pytest.mark.parametrize("level", range(len(BLURS_PX)))
def test_plain_areas_weigh_a_fifth_and_strong_edges_about_one(level):
    counts = np.random.default_rng(level).poisson(20, (120, 240)).astype(np.uint32)
    counts[:, 120:] *= np.tile([1, 40], 60).astype(np.uint32)[:, np.newaxis]
    counts[:, 120:] = counts[:, 120:].repeat(8, axis=0)[:120]
    weights = SmoothedFrame(counts).weights(level)
    # A neighborhood holds 20 to 100 independent values of the noise, so its variance is off by
    # tens of percent, half of them below; what is above counts as texture.
    assert np.median(weights[:, :90]) < 0.3
    assert weights[20:-20, 150:-20].min() > 0.95
    assert 0.2 <= weights.min() <= weights.max() <= 1
