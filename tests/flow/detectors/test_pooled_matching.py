"""Pooled matching: agreement of all pairs of frames, frames laid over one another; burst alignment."""

import math

import numpy as np
import pytest

from megalopta.flow.detectors.blocks import block_grid
from megalopta.flow.detectors.burst_alignment import BurstAlignment
from megalopta.flow.detectors.poisson_matching import (
    Patches,
    SmoothedFrame,
    add_up_pairs,
    agreed_velocities,
    aligned,
    pair_weight,
)

from ..textures import drifting_texture

PATCHES = block_grid((76, 76), 24)
MARGIN_PX = 7


def patches(frames, grid=PATCHES):
    return [Patches(each, grid, MARGIN_PX) for each in frames]


@pytest.mark.parametrize("velocity", [(2.3, -1.6), (-4.0, 0.0), (0.4, 5.2)])
@pytest.mark.parametrize("count", [2, 3, 8])
def test_bright_texture_tells_its_velocity(velocity, count):
    texture = drifting_texture(velocity, count, (76, 76), blur_px=1.0)
    frames = 1e4 * (3 + texture / texture.std() / 3)
    found = agreed_velocities(patches(frames), 7)[4]  # of the block in the middle
    # Correlations interpolated linearly peak where a displacement is whole: half a pixel over the
    # longest baseline, and a tenth for what enters and leaves the patch (its largest of 12: .09).
    np.testing.assert_allclose(found, velocity, atol=0.5 / (count - 1) + 0.1)


def test_score_is_the_weighted_power_of_the_sum_of_aligned_frames():
    # Parseval: Σ_ω W·|Σ_t y_t(ω)·exp(iω·v·t)|² is 2·Σ over pairs + what does not depend on v. At
    # whole velocities the interpolation is exact, and below 38/7 px all pairs overlap.
    counts = np.random.default_rng(0).poisson(3.0, (8, 38, 38))
    seen = patches(counts, block_grid((38, 38), 24, 1))
    size = seen[0].spectra.shape[1]
    full = np.array([np.fft.fft2(each - each.mean(), (size, size)) for each in counts])
    weight = np.abs(np.random.default_rng(1).normal(size=(size, size)))
    weight = (weight + np.roll(weight[::-1, ::-1], 1, axis=(0, 1))) / 2  # of a real filter
    crosses = [
        sum(a.spectra[0].conj() * b.spectra[0] for a, b in zip(seen, seen[k:], strict=False))
        for k in range(1, 8)
    ]
    half = weight[:, : size // 2 + 1]
    correlations = np.fft.irfft2(np.stack(crosses) * half, (size, size)).astype(np.float32)
    scores = np.zeros((29, 29))
    add_up_pairs(correlations, seen[0].side, scores)
    omega_y, omega_x = np.meshgrid(*[2 * np.pi * np.fft.fftfreq(size)] * 2, indexing="ij")
    alone = np.sum(weight * np.sum(np.abs(full) ** 2, axis=0))
    for x, y in ((0, 0), (3, 0), (-2, 1), (5, -5)):
        turned = sum(
            frame * np.exp(1j * t * (omega_x * x + omega_y * y)) for t, frame in enumerate(full)
        )
        expected = (np.sum(weight * np.abs(turned) ** 2) - alone) / 2 / size**2
        # single precision, of terms that cancel
        scale = alone / size**2
        assert scores[14 + 2 * y, 14 + 2 * x] == pytest.approx(expected, abs=1e-4 * scale)


def test_weight_is_that_of_wiener_where_texture_is_strong_and_of_correlation_where_it_is_weak():
    strong = pair_weight(64, 1e9, 2.0, 8)
    np.testing.assert_allclose(strong, 1 / (8 * 2.0), rtol=1e-3)
    weak = pair_weight(64, 1e-9, 2.0, 8)
    omega = 2 * math.pi * np.fft.rfftfreq(64)
    expected = ((omega[6] ** 2 + 0.02) / (omega[13] ** 2 + 0.02)) ** 1.3
    assert weak[0, 13] / weak[0, 6] == pytest.approx(expected, rel=1e-5)  # of single precision


@pytest.mark.parametrize("seen_in", [0, 1])
def test_what_fewer_than_two_frames_show_has_no_velocity(seen_in):
    frames = np.zeros((8, 76, 76))
    frames[8 - seen_in :] = np.random.default_rng(0).poisson(3.0, (76, 76))
    assert np.isnan(agreed_velocities(patches(frames), 7)).all()
    assert np.isnan(agreed_velocities(patches(np.ones((8, 76, 76))), 7)).all()


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


def test_whole_shifts_beyond_the_search_of_one_level_are_exact():
    # 7 px per frame are 14 px between the sums of one frame each, the search reaches 2 px
    frames = drifting_texture((-7.0, 4.0), 4, (144, 144), blur_px=3.0)
    found = BurstAlignment(frames=4, block_px=24).respond(1e4 * (3 + frames))[-1, 1:-1, 1:-1]
    np.testing.assert_allclose(found, np.broadcast_to((-7, 4), found.shape), atol=0.05)


def test_fractions_of_a_pixel_are_told_on_smooth_texture():
    frames = 1e4 * (3 + drifting_texture((0.6, -0.3), 8, (96, 96), blur_px=2.0))
    newest = BurstAlignment(block_px=16).respond(frames)[-1, 1:-1, 1:-1]
    # a parabola through absolute differences is off by less than 0.1 px over four frames
    np.testing.assert_allclose(newest.mean(axis=(0, 1)), (0.6, -0.3), atol=0.03)


def test_velocities_do_not_depend_on_brightness():
    counts = np.random.default_rng(0).poisson(9.0, (8, 60, 60)).astype(np.uint16)
    detector = BurstAlignment()
    np.testing.assert_array_equal(detector.respond(counts), detector.respond(4 * counts))
