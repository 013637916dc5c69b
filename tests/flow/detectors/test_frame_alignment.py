"""Frames laid over one another: motion that is known, and what has none."""

import numpy as np
import pytest

from megalopta.flow.detectors.blocks import block_grid
from megalopta.flow.detectors.frame_alignment import aligned
from megalopta.flow.detectors.shot_noise_blur import SmoothedFrame

SIDE = 72
GRID = block_grid((SIDE, SIDE), 24)


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


def moved(frames, start):
    window = [SmoothedFrame(each) for each in frames]
    return aligned(window, GRID, 7, np.tile(np.asarray(start, float), (9, 1)))


@pytest.mark.parametrize("frames", [2, 3, 8])
@pytest.mark.parametrize("velocity", [(2.3, -1.6), (0.0, 0.5), (-3.13, 0.02)])
def test_velocity_is_found_to_a_hundredth_of_a_pixel_over_all_frames(velocity, frames):
    start = np.add(velocity, (0.2, -0.15))
    found = moved(waves(velocity, frames, 1e4), start)
    # roots of a blurred frame bend the waves alike in all; splines leave some thousandths
    np.testing.assert_allclose(found, np.tile(velocity, (9, 1)), atol=0.01 / (frames - 1) + 0.002)


def test_noise_spreads_velocities_as_the_bound_says():
    clean = waves((1.4, 0.6), 8, 400.0)
    drawn = [np.random.default_rng(seed).poisson(clean) for seed in range(20)]
    found = np.stack([moved(each, (1.4, 0.6)) for each in drawn])[:, 4]
    gy, gx = np.gradient(clean[4])
    inner = slice(24, 48), slice(24, 48)
    information = 42 * np.sum((gx**2 / clean[4])[inner]), 42 * np.sum((gy**2 / clean[4])[inner])
    bound = 1 / np.sqrt(information)  # of each component, the other known
    spread = found.std(axis=0, ddof=1)
    # χ² of 19 degrees of freedom: were the spread 0.8 to 1.2 times the bound, below 1e-7
    assert (spread > 0.25 * bound).all() and (spread < 2.5 * bound).all()


def test_what_would_move_far_or_shows_nothing_stays():
    frames = waves((2.0, 0.0), 8, 1e4)
    np.testing.assert_array_equal(moved(np.full_like(frames, 50.0), (1.3, 0.2)), [[1.3, 0.2]] * 9)
    assert np.isnan(moved(frames, (np.nan, np.nan))).all()
    # all within reach of the search: a wrong start ends near it or where it began
    found = moved(frames, (-4.0, 5.0))
    assert (np.abs(found - (-4.0, 5.0)) <= 1.0).all()
