"""Frames aligned by a motion: the way back, and light that changes unevenly."""

import math

import numpy as np

from megalopta.flow.likelihood.alignment import round_trip


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
