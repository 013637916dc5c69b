import numpy as np
import pytest

from megalopta.sensor.effects.crosstalk import Crosstalk, mean, neighborhood, spread, variance
from megalopta.sensor.sampling.streams import generator

KERNELS = [
    {},
    {"diagonal": 1.0},
    {"diagonal": 0.157, "distance_two": 0.0126},
    {"diagonal": 0.3, "distance_two": 0.2, "distance_three": 0.1},
]


def matrix_of(talk, shape, strength=None):
    """C_ij, written out by distance."""
    y, x = np.indices(shape).reshape(2, -1)
    down, right = np.abs(y[:, None] - y), np.abs(x[:, None] - x)
    shares = {
        (0, 1): 1,
        (1, 1): talk.diagonal,
        (0, 2): talk.distance_two,
        (0, 3): talk.distance_three,
    }
    matrix = sum(
        share * ((np.minimum(down, right) == near) & (np.maximum(down, right) == far))
        for (near, far), share in shares.items()
    )
    matrix = matrix * talk.mean_fired_neighbors / (4 * sum(shares.values()))
    return matrix if strength is None else matrix * strength.ravel()


def exact_moments(light, talk, strength=None):
    matrix = matrix_of(talk, light.shape, strength)
    response = np.linalg.inv(np.eye(light.size) - matrix)
    counts = response @ light.ravel()
    noise = light.ravel() + (matrix * (1 - matrix)) @ counts
    return counts.reshape(light.shape), ((response**2) @ noise).reshape(light.shape)


@pytest.mark.parametrize("shares", KERNELS)
def test_probabilities_of_the_neighbors_add_up(shares):
    weights = neighborhood(Crosstalk(mean_fired_neighbors=0.3, **shares))
    assert weights.sum() == pytest.approx(0.3)
    assert np.count_nonzero(weights) == 4 + 4 * len(shares)
    assert weights[3, 3] == 0
    np.testing.assert_array_equal(weights, weights.T)


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(5, 7), (1, 9), (40, 3)])
@pytest.mark.parametrize("shares", KERNELS)
def test_moments_solve_their_linear_equations_edges_included(shares, shape):
    rng = np.random.default_rng(0)
    light, strength = rng.uniform(0, 9, shape), rng.uniform(0.5, 1.5, shape)
    talk = Crosstalk(mean_fired_neighbors=0.4, **shares)
    for sent in (None, strength):
        counts, spread_counts = exact_moments(light, talk, sent)
        np.testing.assert_allclose(mean(light, talk, sent), counts, rtol=1e-12)
        np.testing.assert_allclose(variance(light, talk, sent), spread_counts, rtol=1e-4)


def test_border_of_a_large_image_is_exact_too():
    light = np.random.default_rng(1).uniform(0, 9, (40, 33))
    talk = Crosstalk(mean_fired_neighbors=0.3, **KERNELS[2])
    _, exact = exact_moments(light, talk)
    np.testing.assert_allclose(variance(light, talk), exact, rtol=1e-4)


def test_spread_is_the_same_for_the_same_generator_and_nothing_when_off():
    counts = generator(0).poisson(5.0, (8, 8))
    talk = Crosstalk(mean_fired_neighbors=0.3)
    first, second = (spread(generator(1), counts, talk) for _ in range(2))
    np.testing.assert_array_equal(first, second)
    np.testing.assert_array_equal(spread(generator(1), counts, Crosstalk()), counts)


def test_runaway_crosstalk_is_refused():
    with pytest.raises(ValueError, match="mean_fired_neighbors"):
        Crosstalk(mean_fired_neighbors=0.95)
