"""Crosstalk and afterpulses from time tags against those that made them."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from megalopta.camera.measurements import read_measurement
from megalopta.cli import main as cli
from megalopta.sensor import Afterpulsing, Crosstalk
from megalopta.sensor.calibrate.crosstalk import fit_crosstalk
from megalopta.sensor.calibrate.time_tags import (
    Autocorrelation,
    afterpulses_between,
    autocorrelation_of,
    coincidences,
    fit_exponential,
    fit_table,
)
from megalopta.sensor.formats.time_tags import TimeTags
from megalopta.sensor.spad.model import AvalancheEffects
from megalopta.sensor.spad.simulation import simulate_frame

EDGES_S = 1e-9 * np.concatenate(([0, 25, 50, 75], np.geomspace(100, 4000, 16)))


def test_a_table_holds_the_same_delays(tags):
    found = autocorrelation_of(tags, EDGES_S)
    lags = np.array([0.0, 50e-9, 200e-9, 1e-6])
    table, curve = (afterpulses_between(fit(found), lags) for fit in (fit_table, fit_exponential))
    assert np.allclose(table, curve, rtol=0.05, atol=3e-4)


def test_a_dead_time_alone_is_refused():
    even = np.zeros((20, EDGES_S.size - 1)) + 1e4 * np.diff(EDGES_S)
    even[:, :4] = 0  # a dead time
    with pytest.raises(ValueError, match="give lags at which some are seen"):
        fit_table(Autocorrelation(EDGES_S, even, np.full(20, 2e4)))


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


ROWS, COLUMNS, DARK_HZ, DURATION_S = 4, 12, 2000.0, 20.0
LIGHT = Crosstalk(mean_fired_neighbors=0.01, diagonal=0.2)
TRAPS = Afterpulsing(mean_carriers=0.02, delay_s=200e-9)


@pytest.fixture(scope="module")
def tags():
    """Two million events of an array of 4 × 12 pixels in the dark."""
    rates = np.full((ROWS, COLUMNS), DARK_HZ)
    effects = AvalancheEffects(crosstalk=LIGHT, afterpulsing=TRAPS)
    frame = simulate_frame(np.random.default_rng(1), rates, DURATION_S, effects)
    order = np.argsort(frame.times_s, kind="stable")
    return TimeTags(frame.times_s[order], frame.pixels[order], rates.size, DURATION_S)


def test_crosstalk_of_neighbors_is_that_of_the_simulation(tags):
    found = coincidences(tags, 1e-9)
    down = found.second // COLUMNS - found.first // COLUMNS
    right = np.abs(found.second % COLUMNS - found.first % COLUMNS)
    edge = LIGHT.mean_fired_neighbors / 4 / 1.2
    for place, expected in (((0, 1), edge), ((1, 0), edge), ((1, 1), 0.2 * edge), ((0, 5), 0.0)):
        at = (down == place[0]) & (right == place[1])
        mean, error = found.probability[at].mean(), found.error[at].mean() / np.sqrt(at.sum())
        # light that comes by a third pixel adds up to 2 % of the square
        assert mean == pytest.approx(expected, abs=5 * error + 3 * edge**2)


def test_afterpulses_are_those_of_the_simulation(tags):
    edges = 1e-9 * np.concatenate(([0.5], np.geomspace(50, 6400, 29)))
    fit = fit_exponential(autocorrelation_of(tags, edges))
    # 40000 afterpulses: 5 standard errors; a second generation adds 2 %
    assert fit.mean_carriers == pytest.approx(TRAPS.mean_carriers, rel=0.06)
    assert fit.delay_s == pytest.approx(TRAPS.delay_s, rel=0.08)


def test_the_command_writes_tables_that_can_be_read(tags, tmp_path, capsys):
    with h5py.File(tmp_path / "dark.hdf5", "w") as file:
        group = file.create_group("photon_data")
        group["timestamps"] = np.rint(tags.time_s / 1e-10).astype(np.int64)
        group["detectors"] = tags.channel.astype(np.uint8)
        group["timestamps_specs/timestamps_unit"] = 1e-10
    words = ["--columns", str(COLUMNS), "--window-ns", "1", "--out", str(tmp_path / "out")]
    cli.main(["spadcam", "tags", str(tmp_path / "dark.hdf5"), *words])
    assert len(capsys.readouterr().out.splitlines()) == 3
    rates = read_measurement(tmp_path / "out/dark-counts.csv")
    assert rates.shape == (ROWS, COLUMNS)
    talk = fit_crosstalk(read_measurement(tmp_path / "out/crosstalk.csv"))
    # of 76 edge pairs with 200 coincidences each: 5 errors are 4 %
    assert talk.mean_fired_neighbors == pytest.approx(LIGHT.mean_fired_neighbors, rel=0.06)
    lags = read_measurement(tmp_path / "out/autocorrelation.csv").of(slice(None), 6.4e-6)
    assert fit_exponential(lags).mean_carriers == pytest.approx(TRAPS.mean_carriers, rel=0.06)
