import numpy as np
import pytest

from megalopta.flow.blocks import block_grid
from megalopta.flow.efficiency import (
    bound_photons,
    confined_velocities,
    median_relative_error,
    photons_for_error,
    variance_efficiency,
)
from megalopta.flow.methods import METHODS

VELOCITY = [
    pytest.param(detector, id=name)
    for name, detector in METHODS.items()
    if detector.gives == "velocity"
]
GRID = block_grid((72, 72), 24)


@pytest.mark.parametrize("detector", VELOCITY)
def test_nothing_outside_of_a_block_and_its_margin_is_seen(detector):
    rng = np.random.default_rng(0)
    counts = rng.poisson(4, (8, 72, 72)).astype(np.uint16)
    elsewhere = rng.poisson(40, counts.shape).astype(np.uint16)
    elsewhere[:, 17:55, 17:55] = counts[:, 17:55, 17:55]
    velocities = [confined_velocities(detector, each, GRID, 7) for each in (counts, elsewhere)]
    assert velocities[0].shape == (1, 1, 2)
    np.testing.assert_array_equal(*velocities)


def test_search_reaches_to_the_end_of_the_margin_and_no_further():
    image = np.random.default_rng(1).poisson(50, (72, 90)).astype(np.uint16)
    for step, found in ((7, True), (8, False)):
        frames = np.stack([image[:, 10 : 10 + 72], image[:, 10 - step : 10 - step + 72]])
        velocity = confined_velocities(METHODS["BM"], frames, GRID, 7)[0, 0]
        assert np.array_equal(velocity, (step, 0)) == found


@pytest.mark.parametrize("margin", [0, 25])
def test_margin_that_leaves_no_room_is_refused(margin):
    with pytest.raises(ValueError, match=f"margin_px {margin}: give 1 to 24"):
        confined_velocities(METHODS["BM"], np.ones((2, 72, 72)), GRID, margin)


def test_undefined_velocities_err_as_much_as_zero():
    velocities = np.array([[3.0, 4.0], [np.nan, np.nan], [0.0, 0.0]])
    assert median_relative_error(velocities, (3.0, 4.0)) == 1
    assert median_relative_error(velocities[:1], (3.0, 4.0)) == 0


@pytest.mark.parametrize("exact", [1.7e3, 5e4, 9e6])
def test_crossing_of_a_power_law_is_found_exactly_with_few_fluxes(exact):
    tried = []

    def error(flux):
        tried.append(flux)
        return 0.25 * (exact / flux) ** 0.5

    fluxes = 10 ** np.linspace(3, 7, 13)
    assert photons_for_error(error, fluxes, 0.25) == pytest.approx(exact)
    assert len(set(tried)) == len(tried) <= 6


def test_errors_on_one_side_of_the_level_have_no_crossing():
    assert photons_for_error(lambda flux: 0.3, (1e3, 1e4, 1e5), 0.25) == np.inf
    assert photons_for_error(lambda flux: 0.1, (1e3, 1e4, 1e5), 0.25) == 0


def test_bound_of_isotropic_errors_has_its_closed_form():
    covariance = 9.0 * np.eye(2)
    flux = bound_photons(covariance, speed=2.0, level=0.25)
    assert 3 * np.sqrt(2 * np.log(2) / flux) == pytest.approx(0.5)


def test_errors_at_the_bound_have_an_efficiency_of_one():
    rng = np.random.default_rng(0)
    covariances = np.array([np.diag([1.0, 4.0]), np.diag([0.1, 0.1]), np.full((2, 2), np.inf)])
    scale = np.sqrt(np.array([[1, 4], [0.1, 0.1], [1, 1]]))
    velocities = scale * rng.standard_normal((4000, 3, 2))
    # a sum of variances from 4000 draws is off by less than √(2/4000) = 2.2 %: five of those
    assert variance_efficiency(velocities, covariances) == pytest.approx(1, abs=0.11)
    assert variance_efficiency(2 * velocities, covariances) == pytest.approx(0.25, abs=0.03)
