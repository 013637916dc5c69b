"""Crosstalk and afterpulses from time tags against those that made them."""

import h5py
import numpy as np
import pytest

from megalopta.camera.capture_files import read_measurement
from megalopta.cli import main as cli
from megalopta.sensor import Afterpulsing, Crosstalk
from megalopta.sensor.calibrate.autocorrelation import fit_exponential
from megalopta.sensor.calibrate.pair_crosstalk import fit_crosstalk
from megalopta.sensor.calibrate.tag_statistics import autocorrelation_of, coincidences
from megalopta.sensor.formats.time_tags import TimeTags
from megalopta.sensor.spad.model import AvalancheEffects
from megalopta.sensor.spad.simulation import simulate_frame

ROWS, COLUMNS, RATE_HZ, DURATION_S = 4, 12, 2000.0, 20.0
LIGHT = Crosstalk(mean_fired_neighbors=0.01, diagonal=0.2)
TRAPS = Afterpulsing(mean_carriers=0.02, delay_s=200e-9)


@pytest.fixture(scope="module")
def tags():
    """Two million events of an array of 4 × 12 pixels in the dark."""
    rates = np.full((ROWS, COLUMNS), RATE_HZ)
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
