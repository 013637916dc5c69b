"""Burst alignment on motion that is known."""

import numpy as np

from megalopta.flow.detectors.burst_alignment import BurstAlignment

from ..textures import drifting_texture


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
