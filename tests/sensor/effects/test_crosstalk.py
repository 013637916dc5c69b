import numpy as np
import pytest

from megalopta.sensor.effects.crosstalk import Crosstalk, mean, neighborhood, spread, variance
from megalopta.sensor.sampling import generator

POINT = np.zeros((25, 25))
POINT[12, 12] = 1.0


@pytest.mark.parametrize("neighbors", [4, 8])
def test_probabilities_of_the_neighbors_add_up(neighbors):
    weights = neighborhood(Crosstalk(probability=0.3, neighbors=neighbors))
    assert weights.sum() == pytest.approx(0.3)
    assert np.count_nonzero(weights) == neighbors
    assert weights[1, 1] == 0


@pytest.mark.parametrize("neighbors", [4, 8])
def test_mean_conserves_avalanches_away_from_the_edge(neighbors):
    total = mean(POINT, Crosstalk(probability=0.2, neighbors=neighbors)).sum()
    assert total == pytest.approx(1 / 0.8, rel=1e-6)


def test_mean_solves_its_linear_equation_edges_included():
    light = np.random.default_rng(0).uniform(0, 9, (5, 7))
    talk = Crosstalk(probability=0.4)
    index = np.arange(35).reshape(5, 7)
    neighbors = np.zeros((35, 35))
    for a, b in ((index[1:], index[:-1]), (index[:, 1:], index[:, :-1])):
        neighbors[a.ravel(), b.ravel()] = neighbors[b.ravel(), a.ravel()] = 0.1
    exact = np.linalg.solve(np.eye(35) - neighbors, light.ravel()).reshape(5, 7)
    np.testing.assert_allclose(mean(light, talk), exact, rtol=1e-12)


def test_variance_of_a_lone_bright_pixel_has_what_comes_back_from_its_neighbors():
    # primaries, and those that come back after two steps, to second order in c = p/4
    talk = Crosstalk(probability=0.04)
    own = variance(POINT, talk)[12, 12]
    assert own == pytest.approx(1 + 3 * 4 * 0.01**2, abs=1e-5)


def test_spread_is_the_same_for_the_same_generator_and_nothing_when_off():
    counts = generator(0).poisson(5.0, (8, 8))
    first, second = (spread(generator(1), counts, Crosstalk(probability=0.3)) for _ in range(2))
    np.testing.assert_array_equal(first, second)
    np.testing.assert_array_equal(spread(generator(1), counts, Crosstalk()), counts)


def test_runaway_crosstalk_is_refused():
    with pytest.raises(ValueError, match="probability"):
        Crosstalk(probability=0.95)
