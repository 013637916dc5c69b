"""Whole displacements that are likelier than the flow so far."""

import numpy as np

from megalopta.flow.large_motion import with_large_motion
from megalopta.flow.likelihood import NODE_PX, level_of

from .textures import drifting_texture

SHAPE = (64, 80)
TIMES = np.array([0.0, 1.0])
NODES = (2, SHAPE[0] // NODE_PX, SHAPE[1] // NODE_PX)


def level(photons, fast=(7.0, -3.0), seed=0):
    """A ground at rest, and a square of 24 px with another motion."""
    ground, square = (
        drifting_texture(velocity, 2, SHAPE, blur_px=1.5, seed=seed + each)
        for each, velocity in enumerate(((0.0, 0.0), fast))
    )
    texture = ground.copy()
    for frame, time in enumerate(TIMES):
        top, left = 24 + int(time * fast[1]), 20 + int(time * fast[0])
        inside = np.s_[frame, top : top + 24, left : left + 24]
        texture[inside] = square[inside]
    light = (1 + 0.3 * texture / texture.std()).clip(0.05)
    return level_of(np.random.default_rng(seed).poisson(photons * light).astype(float))


def test_a_fast_square_over_still_ground_is_found():
    found = with_large_motion(level(30.0), TIMES, np.zeros(NODES))
    np.testing.assert_array_equal(found[0, 7:11, 6:10], 7)
    np.testing.assert_array_equal(found[1, 7:11, 6:10], -3)
    # the content of pixels that the square hides in the second frame may seem to move
    far = np.ones(NODES[1:], bool)
    far[3:14, 3:15] = False
    assert not found[:, far].any()


def test_a_flow_that_is_right_moves_by_no_more_than_rounding():
    right = np.zeros(NODES)
    right[0, 6:12, 5:11], right[1, 6:12, 5:11] = 7.02, -2.98
    found = with_large_motion(level(30.0), TIMES, right)
    assert np.abs(found - right)[:, 7:11, 6:10].max() < 0.03
    assert not found[:, :3].any() and not found[:, 14:].any()
