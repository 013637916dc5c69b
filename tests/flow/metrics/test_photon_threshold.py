"""Crossings of synthetic curves, their intervals, and how they print."""

import numpy as np
import pytest

from megalopta.flow.metrics.photon_threshold import Threshold, first_crossing, threshold

FLUXES = 10.0 ** np.arange(3, 9.1, 0.5)


def crossing(errors, level=0.25, standard_errors=None, degrees=10, seed=0):
    if standard_errors is None:
        standard_errors = np.zeros_like(errors)
    rng = np.random.default_rng(seed)
    return threshold(FLUXES, errors, standard_errors, degrees, level, rng)


@pytest.mark.parametrize("slope", [0.3, 0.5, 2.0])
@pytest.mark.parametrize("true_flux", [1.1e3, 4.7e4, 9.9e7])
def test_power_law_is_interpolated_exactly(slope, true_flux):
    errors = 0.25 * (FLUXES / true_flux) ** -slope
    found = crossing(errors)
    assert found.kind == "crossing"
    assert found.flux == pytest.approx(true_flux, rel=1e-9)
    assert found.low == pytest.approx(true_flux, rel=1e-9)
    assert found.high == pytest.approx(true_flux, rel=1e-9)


def test_first_of_several_crossings_counts():
    errors = np.array([1, 0.1, 1, 1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1])
    assert FLUXES[0] < first_crossing(FLUXES, errors, 0.25) < FLUXES[1]


def test_curve_that_stays_above_or_starts_below_says_so():
    assert str(crossing(np.full(FLUXES.size, 0.3))) == "> 1 billion"
    assert str(crossing(np.full(FLUXES.size, 0.2))) == "< 1000"
    assert str(crossing(np.full(FLUXES.size, np.nan))) == "undefined"
    interval = Threshold("crossing", 0.25, 1e3, 1e12, 41234, 38950, 43480)
    assert str(interval) == "41\u202f200 (39\u202f000 to 43\u202f500)"


@pytest.mark.parametrize("repeats", [2, 4, 10])
def test_interval_covers_the_truth_as_often_as_it_promises(repeats):
    # 95 % of 300 trials have a standard deviation of 1.3 %; below 88.5 % is 5 of them off. Few
    # repeats may cover more often, never less; all of 300 have a probability of 2e-7 at 95 %.
    rng = np.random.default_rng(0)
    true_flux, covered, trials = 3.7e5, 0, 300
    truth = 0.25 * (FLUXES / true_flux) ** -0.5
    for trial in range(trials):
        draws = truth * (1 + 0.05 * rng.normal(size=(repeats, FLUXES.size)))
        standard_errors = draws.std(axis=0, ddof=1) / np.sqrt(repeats)
        found = crossing(draws.mean(axis=0), 0.25, standard_errors, repeats - 1, seed=trial)
        low, high = found.low or 0, found.high or np.inf
        covered += low <= true_flux <= high
    assert covered / trials > 0.885
    if repeats == 10:
        assert covered / trials < 1
