"""Poisson matching of two and of eight frames on textures whose motion is known; its smoothing, costs."""

import numpy as np
import pytest

from megalopta.assets_gen.dead_leaves_model import dead_leaves
from megalopta.flow.detectors.blocks import block_grid
from megalopta.flow.detectors.poisson_matching import (
    BLURS_PX,
    PoissonMatching,
    PooledMatching,
    SmoothedFrame,
    add_costs,
    block_moments,
    blur_levels,
    least_cost,
    parabola_minimum,
)

BOTH = [PoissonMatching(), PooledMatching()]
SIZE = 120


@pytest.fixture(scope="module")
def leaves():
    return dead_leaves((SIZE, SIZE), np.random.default_rng(1), (2.5, 30.0))


def drifting(image, velocity, photons_per_px, frames=8, seed=0):
    """Counts of an image that drifts by (x, y) px per frame around a torus."""
    fy, fx = np.fft.fftfreq(SIZE)[:, None], np.fft.fftfreq(SIZE)
    # what a displacement by fractions of a pixel would overshoot at is smoothed away first
    spectrum = np.fft.fft2(image) * np.exp(-2 * (np.pi * 0.6) ** 2 * (fx**2 + fy**2))
    turns = fx * velocity[0] + fy * velocity[1]
    clean = [np.fft.ifft2(spectrum * np.exp(-2j * np.pi * turns * t)).real for t in range(frames)]
    means = np.maximum(clean, 0) * (photons_per_px / image.mean())
    return np.random.default_rng(seed).poisson(means).astype(np.uint32)


@pytest.mark.parametrize("detector", BOTH, ids=lambda each: each.name)
@pytest.mark.parametrize("velocity", [(-3, 1), (0, 0), (1.25, -0.25), (1.5, -0.5)])
def test_velocity_to_the_right_and_down_is_positive_and_unbiased(leaves, detector, velocity):
    counts = drifting(leaves, velocity, 1000)
    bias = np.median(detector.respond(counts)[-1] - velocity, axis=(0, 1))
    # A parabola through costs of a texture smoothed by 0.7 px bends by up to 0.03 px between
    # pixels; photons add 0.01 px per block, less in the median of a hundred.
    assert np.abs(bias).max() < 0.05


def test_pooling_starts_with_the_frames_there_are(leaves):
    counts = drifting(leaves, (2, 1), 1000)
    np.testing.assert_array_equal(
        PooledMatching(frames=5).respond(counts)[1], PooledMatching().respond(counts[:3])[-1]
    )
    assert PooledMatching().respond(counts).shape == PoissonMatching().respond(counts).shape


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


def test_costs_are_the_weighted_sums_of_squares_of_every_shift():
    rng = np.random.default_rng(0)
    first, second, weights = rng.random((3, 30, 34), np.float32)
    corners, origins = np.array([[3, 5], [20, 22]]), np.array([[4, 5], [18, 20]])
    costs = np.ones((2, 9, 9))
    add_costs(first, second, weights, np.hstack((origins, corners)), 8, costs)
    for block, dy, dx in np.ndindex(costs.shape):
        (row, column), (top, left) = corners[block], origins[block] - (dy - 4, dx - 4)
        inside = 0 <= top <= 22 and 0 <= left <= 26
        here = np.s_[row : row + 8, column : column + 8]
        expected = np.inf
        if inside:
            difference = second[here].astype(float) - first[top : top + 8, left : left + 8]
            expected = 1 + (weights[here] * difference**2).sum()
        # float32 sums of 64 squares
        assert costs[block, dy, dx] == pytest.approx(expected, rel=1e-5)


Y, X = np.mgrid[-1:2, -1:2].astype(float)


def tilted(x, y):
    return 2 * (X - x) ** 2 + 1.2 * (X - x) * (Y - y) + (Y - y) ** 2


@pytest.mark.parametrize(
    ("costs", "place"),
    [
        (tilted(0.3, -0.2), (0.3, -0.2)),
        (tilted(0.49, 0.51), (0.49, 0.51)),
        ((X - 0.3) ** 2, (0.3, 0)),  # stripes
        (-(Y**2), (0, 0)),
        (np.where(X == 1, np.inf, (X - 0.3) ** 2 + (Y - 0.4) ** 2), (0, 0.4)),  # frame's edge
    ],
)
def test_minimum_of_a_parabola_is_exact_where_there_is_one(costs, place):
    np.testing.assert_allclose(parabola_minimum(costs[np.newaxis])[0], place, atol=1e-12)


def test_least_of_all_costs_is_found_in_whole_pixels():
    costs = np.random.default_rng(3).random((4, 7, 7))
    costs[:, 0] = np.inf
    costs[2, 6, 1] = -1
    shifts, exist = least_cost(costs)
    np.testing.assert_array_equal(shifts[2], (-2, 3))
    assert exist.all()
    for value in (0.0, np.inf):
        assert not least_cost(np.full((1, 5, 5), value))[1].any()
