import numpy as np
import pytest

from megalopta.sensor import load_sensor
from megalopta.sensor.effects.crosstalk import Crosstalk, mean, neighborhoods, variance

from ..plainest import chances

KERNELS = [
    {},
    {"diagonal": 1.0},
    {"diagonal": 0.157, "distance_two": 0.0126},
    {"diagonal": 0.3, "distance_two": 0.2, "distance_three": 0.1},
]


PAIRS = np.random.default_rng(3).uniform(0, 1, (2, 3, 5, 9))
PAIRS[:, :, 2, 4] = 0
BY_PLACE = Crosstalk(mean_fired_neighbors=0.4, kernel=PAIRS.tolist())


def exact_moments(light, talk, strength=None):
    matrix = chances(talk, *light.shape).T
    matrix = matrix if strength is None else matrix * strength.ravel()
    response = np.linalg.inv(np.eye(light.size) - matrix)
    counts = response @ light.ravel()
    noise = light.ravel() + (matrix * (1 - matrix)) @ counts
    return counts.reshape(light.shape), ((response**2) @ noise).reshape(light.shape)


@pytest.mark.parametrize("shares", KERNELS)
def test_probabilities_of_the_neighbors_add_up(shares):
    weights = neighborhoods(Crosstalk(mean_fired_neighbors=0.3, **shares))[0, 0]
    assert weights.sum() == pytest.approx(0.3)
    assert np.count_nonzero(weights) == 4 + 4 * len(shares)
    assert weights[3, 3] == 0
    np.testing.assert_array_equal(weights, weights.T)


@pytest.mark.parametrize("shape", [(5, 7), (1, 9), (40, 3)])
@pytest.mark.parametrize(
    "talk", [*(Crosstalk(mean_fired_neighbors=0.4, **shares) for shares in KERNELS), BY_PLACE]
)
def test_moments_solve_their_linear_equations_edges_included(talk, shape):
    rng = np.random.default_rng(0)
    light, strength = rng.uniform(0, 9, shape), rng.uniform(0.5, 1.5, shape)
    for sent in (None, strength):
        counts, spread_counts = exact_moments(light, talk, sent)
        np.testing.assert_allclose(mean(light, talk, sent), counts, rtol=1e-12)
        np.testing.assert_allclose(variance(light, talk, sent), spread_counts, rtol=1e-4)


def test_a_device_file_may_name_a_kernel(tmp_path):
    np.save(tmp_path / "kernel.npy", PAIRS)
    file = tmp_path / "device.yaml"
    file.write_text(
        "preset: ideal\ncrosstalk: {mean_fired_neighbors: 0.4, kernel: {path: kernel.npy}}\n"
    )
    assert load_sensor(file).crosstalk == BY_PLACE
    file.write_text("preset: ideal\ncrosstalk: {kernel: {path: nothing.npy}}\n")
    with pytest.raises(ValueError, match=r"crosstalk\.kernel: .* cannot be read"):
        load_sensor(file)
