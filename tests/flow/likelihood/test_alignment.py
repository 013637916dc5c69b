"""Frames aligned by a motion: the way back, and light that changes unevenly."""

import math

import numpy as np

from megalopta.flow.likelihood.alignment import round_trip
from megalopta.flow.likelihood.dense_flow import likelihood_flow

from ..textures import drifting_texture


def test_flow_there_and_back_leads_home():
    row, column = np.mgrid[:20, :30].astype(float)
    there = np.stack([0.1 * column, -0.05 * row])
    # its exact inverse: x + u = 1.1·x, y + v = 0.95·y
    back = np.stack([column / 1.1 - column, row / 0.95 - row])
    inside = 1.1 * column <= 29
    distance = round_trip(there, back)
    np.testing.assert_allclose(distance[inside], 0, atol=1e-12)
    assert np.isinf(distance[~inside]).all()
    there[:, 3, 4] = np.nan
    assert np.isinf(round_trip(there, back)[3, 4])
    np.testing.assert_allclose(round_trip(there, back + 3)[5, 5], 3 * math.sqrt(2))


def test_light_that_changes_along_a_ramp_costs_little():
    texture = drifting_texture((2.3, -1.1), 2, (112, 128), blur_px=2.0)
    light = (1 + 0.3 * texture / texture.std()).clip(0.05)
    ramp = 1 + 0.2 * np.array([[[0]], [[1]]]) * np.linspace(-1, 1, 128)
    even, uneven = (
        likelihood_flow(np.random.default_rng(0).poisson(100 * light * gain), 0.2) - (2.3, -1.1)
        for gain in (1, ramp)
    )
    assert np.median(np.abs(uneven)) < 1.5 * np.median(np.abs(even))
