import numpy as np
import pytest

from megalopta.flow.shift_cost import add_costs, best_shift


def test_costs_are_the_weighted_sums_of_squares_of_every_shift():
    rng = np.random.default_rng(0)
    first, second, weights = rng.random((3, 30, 34), np.float32)
    corners, origins = np.array([[3, 5], [20, 22]]), np.array([[4, 5], [18, 20]])
    costs = np.ones((2, 9, 9))
    add_costs(first, second, weights, origins, corners, 8, costs)
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


@pytest.mark.parametrize("place", [(0.3, -1.2), (-2.4, 0.0), (1.49, 2.51)])
def test_minimum_of_a_tilted_parabola_is_exact(place):
    y, x = np.mgrid[-4:5, -4:5].astype(float)
    dx, dy = x - place[0], y - place[1]
    costs = (2 * dx**2 + 1.2 * dx * dy + dy**2)[np.newaxis]
    np.testing.assert_allclose(best_shift(costs)[0], place, atol=1e-12)


def test_edge_of_the_frame_leaves_whole_pixels_across_it():
    y, x = np.mgrid[-3:4, -3:4].astype(float)
    costs = ((x - 0.3) ** 2 + (y - 0.4) ** 2)[np.newaxis]
    costs[:, :, 4:] = np.inf
    np.testing.assert_allclose(best_shift(costs)[0], (0, 0.4), atol=1e-12)


@pytest.mark.parametrize("value", [0.0, 5.0, np.inf])
def test_equal_costs_have_no_best_shift(value):
    assert np.isnan(best_shift(np.full((1, 5, 5), value))).all()
