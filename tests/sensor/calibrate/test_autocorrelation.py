"""Afterpulses from pairs of events against the afterpulsing of simulated events."""

from pathlib import Path

import numpy as np
import pytest

from megalopta.camera.capture_files import read_measurement
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


@pytest.mark.parametrize("array", [1, 2])
def test_a_table_holds_the_tail_of_a_real_array_that_an_exponential_misses(array):
    arrays = Path(__file__).parents[3] / "docs/public_arrays"
    pulses = read_measurement(arrays / f"autocorrelation-{array}.csv").of(slice(None), 8e-6)
    fitted, tested = pulses.of(slice(0, None, 2)), pulses.of(slice(1, None, 2))
    lags = np.array([400e-9, 800e-9])
    sums = np.cumsum(tested.afterpulses * np.diff(tested.edges_s), axis=1)
    of_pixels = np.array([np.diff(np.interp(lags, tested.edges_s[1:], row))[0] for row in sums])
    error = of_pixels.std(ddof=1) * np.sqrt(2 / of_pixels.size)
    exponential, table = (
        (of_pixels.mean() - afterpulses_between(fit(fitted), lags)[0]) / error
        for fit in (fit_exponential, fit_table)
    )
    assert exponential > 3
    assert abs(table) < 1
