import numpy as np
import pytest
from scipy.special import ndtri

from megalopta.flow.detectors.blocks import block_grid
from megalopta.flow.detectors.registry import METHODS
from megalopta.flow.metrics.translation_bound import (
    bound_photons,
    confined_velocities,
    photons_for_half,
    variance_efficiency,
)

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


FLUXES = tuple(10 ** np.linspace(3, 7, 13))


@pytest.mark.parametrize("exact", [1.7e3, 5e4, 3.5e5, 4.6e6])
def test_flux_at_which_half_are_good_is_found_with_few_fluxes(exact):
    # One block after the other becomes good, at fluxes of normal logs: the steepest share that a
    # method shows is about this one. Its bend between the fluxes tried is worth 3 %.
    needs = exact * np.exp(ndtri((np.arange(2000) + 0.5) / 2000))
    tried = []

    def is_good(flux):
        tried.append(flux)
        return needs < flux

    needed = photons_for_half(is_good, FLUXES, np.random.default_rng(0))
    assert needed.photons == pytest.approx(exact, rel=0.03)
    assert needed.low < needed.photons < needed.high
    assert len(set(tried)) == len(tried) <= 6


def test_interval_is_that_of_groups_whose_blocks_are_alike():
    # twenty blocks with one need, in each of forty groups: as if there were forty blocks
    rng = np.random.default_rng(0)
    widths = {}
    for copies in (1, 20):
        found = []
        for _ in range(60):
            needs = 5e4 * np.exp(1.5 * rng.standard_normal((40, 1))) * np.ones(copies)
            found.append(photons_for_half(lambda flux, needs=needs: needs < flux, FLUXES, rng))
        widths[copies] = np.mean([np.log(each.high / each.low) for each in found])
    # a width scatters by 20 %: the mean of sixty by 2.6 %, a quotient by 3.7 %
    assert widths[20] == pytest.approx(widths[1], rel=0.2)


def test_shares_on_one_side_of_half_have_no_crossing():
    rng = np.random.default_rng(0)
    for good, flux in ((False, np.inf), (True, 0)):
        found = photons_for_half(lambda _, good=good: np.full(9, good), FLUXES, rng)
        assert found == (flux, flux, flux)


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
