"""Afterpulses from pairs of events against the afterpulsing of simulated events."""

import numpy as np
import pytest

from megalopta.sensor import Afterpulsing
from megalopta.sensor.calibrate.autocorrelation import (
    Autocorrelation,
    afterpulses_between,
    fit_exponential,
    fit_table,
)
from megalopta.sensor.spad.model import AvalancheEffects
from megalopta.sensor.spad.simulation import simulate_frame

CARRIERS, DELAY_S, RATE_HZ = 0.05, 100e-9, 2e4
EDGES_S = 1e-9 * np.concatenate(([0, 25, 50, 75], np.geomspace(100, 4000, 16)))


@pytest.fixture(scope="module")
def found():
    """Pairs of events of 20 pixels in 1 s, 4e5 events."""
    effects = AvalancheEffects(afterpulsing=Afterpulsing(mean_carriers=CARRIERS, delay_s=DELAY_S))
    rates = np.full((1, 20), RATE_HZ)
    frame = simulate_frame(np.random.default_rng(1), rates, 1.0, effects)
    pairs, events = np.zeros((20, EDGES_S.size - 1)), np.zeros(20)
    for pixel in range(20):
        times = np.sort(frame.times_s[frame.pixels == pixel])
        after = [np.searchsorted(times, times + edge, "right") for edge in EDGES_S]
        pairs[pixel], events[pixel] = np.diff([np.sum(each) for each in after]), times.size
    return Autocorrelation(EDGES_S, pairs, events)


def test_an_exponential_gives_carriers_and_delay(found):
    fit = fit_exponential(found)
    # a second generation, p² of all events, adds to pairs; 20000 afterpulses, 5 standard errors
    expected = CARRIERS / (1 - CARRIERS)
    assert fit.mean_carriers == pytest.approx(expected, rel=5 / np.sqrt(2e4) + CARRIERS / 10)
    assert fit.delay_s == pytest.approx(DELAY_S, rel=0.12)


def test_a_table_holds_the_same_delays(found):
    lags = np.array([0.0, 50e-9, 200e-9, 1e-6])
    table, curve = (afterpulses_between(fit(found), lags) for fit in (fit_table, fit_exponential))
    assert np.allclose(table, curve, rtol=0.05, atol=3e-4)


def test_a_dead_time_alone_is_refused(found):
    even = found.pairs * 0 + 1e4 * np.diff(EDGES_S)
    even[:, :4] = 0  # a dead time
    with pytest.raises(ValueError, match="give lags at which some are seen"):
        fit_table(found._replace(pairs=even))
