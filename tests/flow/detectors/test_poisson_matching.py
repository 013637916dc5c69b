"""Poisson matching of two and of eight frames on textures whose motion is known; its smoothing."""

import numpy as np
import pytest

from megalopta.assets_gen.surface_textures import dead_leaves
from megalopta.flow.detectors.burst_alignment import BurstAlignment
from megalopta.flow.detectors.poisson_matching import PoissonMatching, PooledMatching

from ..textures import drifting_texture

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


@pytest.mark.parametrize("seen_in", [0, 1])
def test_what_fewer_than_two_frames_show_has_no_velocity(seen_in):
    frames = np.zeros((8, 76, 76))
    frames[8 - seen_in :] = np.random.default_rng(0).poisson(3.0, (76, 76))
    assert np.isnan(PooledMatching(block_px=24).respond(frames)).all()
    assert np.isnan(PooledMatching(block_px=24).respond(np.ones((8, 76, 76)))).all()


SIDE = 72


def waves(velocity, frames, photons):
    """Frames of ten plane waves of 5 px and longer that drift; band-limited, so exact anywhere."""
    rng = np.random.default_rng(3)
    omega = rng.uniform(0.3, 2 * np.pi / 5, 10)[:, np.newaxis] * np.stack(
        (np.cos(angle := rng.uniform(0, np.pi, 10)), np.sin(angle)), axis=-1
    )
    phases, (y, x) = rng.uniform(0, 2 * np.pi, 10), np.mgrid[:SIDE, :SIDE]
    times = np.arange(frames) - (frames - 1) / 2
    places = np.stack((x, y), axis=-1) - times[:, None, None, None] * np.asarray(velocity)
    texture = np.cos(places @ omega.T + phases).sum(axis=-1)
    return photons * (1 + texture / 12)


@pytest.mark.parametrize("frames", [3, 8])
@pytest.mark.parametrize("velocity", [(2.3, -1.6), (0.0, 0.5), (-3.13, 0.02)])
def test_velocity_is_found_to_a_hundredth_of_a_pixel_over_all_frames(velocity, frames):
    detector = PooledMatching(block_px=24, radius_px=7, frames=frames)
    found = detector.respond(waves(velocity, frames, 1e4))[-1]
    # roots of a blurred frame bend the waves alike in all; splines leave some thousandths
    np.testing.assert_allclose(
        found, np.broadcast_to(velocity, (3, 3, 2)), atol=0.01 / (frames - 1) + 0.002
    )


def test_whole_shifts_beyond_the_search_of_one_level_are_exact():
    # 7 px per frame are 14 px between the sums of one frame each, the search reaches 2 px
    frames = drifting_texture((-7.0, 4.0), 4, (144, 144), blur_px=3.0)
    found = BurstAlignment(frames=4, block_px=24).respond(1e4 * (3 + frames))[-1, 1:-1, 1:-1]
    np.testing.assert_allclose(found, np.broadcast_to((-7, 4), found.shape), atol=0.05)
