"""Poisson matching of two and of eight frames on textures whose motion is known."""

import numpy as np
import pytest

from megalopta.assets_gen.dead_leaves_model import dead_leaves
from megalopta.flow.detectors.poisson_matching import PoissonMatching
from megalopta.flow.detectors.pooled_matching import PooledMatching

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
@pytest.mark.parametrize("velocity", [(2, 0), (-3, 1), (0, -2), (0, 0)])
def test_content_that_moves_right_and_down_has_positive_velocity(leaves, detector, velocity):
    velocities = detector.respond(drifting(leaves, velocity, 1e5))[-1]
    error = np.hypot(*(velocities[2:-2, 2:-2] - velocity).reshape(-1, 2).T)
    # at 1e5 photons per pixel a block of 12 × 12 px errs by less than 0.01 px
    assert np.median(error) < 0.02


@pytest.mark.parametrize("detector", BOTH, ids=lambda each: each.name)
@pytest.mark.parametrize("fraction", [0.25, 0.5, 0.75])
def test_fractions_of_a_pixel_are_unbiased(leaves, detector, fraction):
    velocity = (1 + fraction, -fraction)
    counts = drifting(leaves, velocity, 1000)
    bias = np.median(detector.respond(counts)[-1] - velocity, axis=(0, 1))
    # A parabola through costs of a texture smoothed by 0.7 px bends by up to 0.03 px between
    # pixels; photons add 0.01 px per block, less in the median of a hundred.
    assert np.abs(bias).max() < 0.05


@pytest.mark.parametrize("detector", BOTH, ids=lambda each: each.name)
def test_darkness_has_no_velocity(detector):
    counts = np.zeros((8, 60, 60), np.uint16)
    assert np.isnan(detector.respond(counts)).all()


def test_one_dark_block_does_not_disturb_the_others(leaves):
    counts = drifting(leaves, (2, 0), 100)
    whole = PoissonMatching().respond(counts)[-1]
    counts[:, 24:72, 24:72] = 0
    holed = PoissonMatching().respond(counts)[-1]
    assert np.isnan(holed[3, 3]).all()
    np.testing.assert_array_equal(holed[8:], whole[8:])


def test_pooling_starts_with_the_frames_there_are(leaves):
    counts = drifting(leaves, (2, 1), 1000)
    np.testing.assert_array_equal(
        PooledMatching(frames=5).respond(counts)[1], PooledMatching().respond(counts[:3])[-1]
    )
    assert PooledMatching().respond(counts).shape == PoissonMatching().respond(counts).shape


def test_pooling_forgets_what_is_older_than_its_frames(leaves):
    counts = drifting(leaves, (2, 1), 100)
    newest = PooledMatching(frames=4).respond(counts[4:])[-1]
    np.testing.assert_array_equal(PooledMatching(frames=4).respond(counts)[-1], newest)
