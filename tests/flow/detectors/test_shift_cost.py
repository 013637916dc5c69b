import numpy as np
import pytest

from megalopta.flow.detectors.shift_cost import add_costs, least_cost, parabola_minimum


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


@pytest.mark.parametrize("place", [(0.3, -0.2), (-0.4, 0.0), (0.49, 0.51)])
def test_minimum_of_a_tilted_parabola_is_exact(place):
    y, x = np.mgrid[-1:2, -1:2] - np.array(place)[::-1, np.newaxis, np.newaxis]
    costs = (2 * x**2 + 1.2 * x * y + y**2)[np.newaxis]
    np.testing.assert_allclose(parabola_minimum(costs)[0], place, atol=1e-12)


def test_stripes_have_a_minimum_across_them_and_none_along():
    y, x = np.mgrid[-1:2, -1:2].astype(float)
    np.testing.assert_allclose(parabola_minimum((x - 0.3)[np.newaxis] ** 2)[0], (0.3, 0))
    np.testing.assert_array_equal(parabola_minimum(-(y[np.newaxis] ** 2))[0], (0, 0))


def test_edge_of_the_frame_leaves_whole_pixels_across_it():
    y, x = np.mgrid[-1:2, -1:2].astype(float)
    costs = ((x - 0.3) ** 2 + (y - 0.4) ** 2)[np.newaxis]
    costs[:, :, 2] = np.inf
    np.testing.assert_allclose(parabola_minimum(costs)[0], (0, 0.4), atol=1e-12)


def test_least_of_all_costs_is_found_in_whole_pixels():
    costs = np.random.default_rng(3).random((4, 7, 7))
    costs[:, 0] = np.inf
    costs[2, 6, 1] = -1
    shifts, exist = least_cost(costs)
    np.testing.assert_array_equal(shifts[2], (-2, 3))
    assert exist.all()


@pytest.mark.parametrize("value", [0.0, 5.0, np.inf])
def test_equal_costs_have_no_least(value):
    assert not least_cost(np.full((1, 5, 5), value))[1].any()
