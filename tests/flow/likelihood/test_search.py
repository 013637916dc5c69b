"""Search for motion beyond the reach of Newton's steps."""

import numpy as np

from megalopta.flow.likelihood.dense_flow import likelihood_flow

from ..textures import drifting_texture


def test_a_motion_of_a_fifth_of_the_width_is_found():
    texture = drifting_texture((60.0, 0.0), 2, (64, 320), blur_px=3.0, margin=40)
    light = (1 + 0.3 * texture / texture.std()).clip(0.05)
    flow = likelihood_flow(np.random.default_rng(0).poisson(30 * light), 0.2)
    stays = flow[8:-8, 8:-68]
    assert np.median(np.hypot(*np.moveaxis(stays - (60, 0), -1, 0))) < 0.2
