"""Device files of public arrays: what was published about them is what they simulate."""

from pathlib import Path

import numpy as np
import pytest

from megalopta.camera.capture_files import read_measurement
from megalopta.camera.device_files import write_array_device
from megalopta.cli.main import main
from megalopta.sensor import expose_events, load_sensor
from megalopta.sensor.calibrate.tag_statistics import coincidences
from megalopta.sensor.change import changed
from megalopta.sensor.formats.time_tags import TimeTags

ARRAYS = Path(__file__).parents[3] / "docs/public_arrays"
KINDS = "dark-counts", "crosstalk", "autocorrelation"
SECONDS, FRAMES = 20.0, 10


def tags_in_the_dark(path):
    sensor = changed(load_sensor(path), exposure_s=SECONDS)
    events = expose_events(
        np.zeros((FRAMES, 4, 12)), sensor, seed=1, stream="dark", free_running=True
    )
    times = events.time_s + SECONDS * events.frame
    return TimeTags(times, events.pixel.astype(np.int64), 48, SECONDS * FRAMES)


@pytest.mark.parametrize("number", [1, 2])
def test_the_command_writes_the_files_that_ship(number, tmp_path):
    out = tmp_path / f"array-{number}.yaml"
    tables = [str(ARRAYS / f"{kind}-{number}.csv") for kind in KINDS]
    main(["spadcam", "calibrate", *tables, "--preset", "ideal", "--out", str(out)])
    shipped = ARRAYS / out.name
    assert out.read_text("utf-8") == shipped.read_text("utf-8")
    np.testing.assert_allclose(
        np.load(tmp_path / out.stem / "dark_counts.npy"),
        np.load(ARRAYS / out.stem / "dark_counts.npy"),
    )


@pytest.mark.parametrize("number", [1, 2])
def test_simulated_arrays_have_the_published_rates_and_crosstalk(number):
    tags = tags_in_the_dark(ARRAYS / f"array-{number}.yaml")
    rates = read_measurement(ARRAYS / f"dark-counts-{number}.csv").ravel()
    events = np.bincount(tags.channel, minlength=48)
    known = np.isfinite(rates)
    # Poisson numbers of events, and 3 % more variance by afterpulses: five errors; later
    # afterpulses than 8 µs are not in the model, nor crosstalk beyond three pixels: 0.3 %
    expected = rates[known] * tags.duration_s
    error = np.hypot(1.03 * np.sqrt(expected), 0.003 * expected)
    assert (np.abs(events[known] - expected) < 5 * error).all()
    pairs = read_measurement(ARRAYS / f"crosstalk-{number}.csv")
    found = coincidences(tags, 25e-9)
    down, right = (np.abs(each) for each in np.subtract(
        np.divmod(found.second, 12), np.divmod(found.first, 12)
    ))  # fmt: skip
    for place in ((0, 1), (1, 0), (1, 1)):
        measured = pairs.at(*place)
        ours = found.probability[(down == place[0]) & (right == place[1])]
        errors = [each.std(ddof=1) / np.sqrt(each.size) for each in (measured.probability, ours)]
        # the model has one share at each distance: rows and columns differ by 1 %
        limit = 5 * np.hypot(*errors)
        assert measured.probability.mean() == pytest.approx(ours.mean(), abs=limit)


def test_tables_of_one_kind_and_without_dark_counts_are_refused(tmp_path):
    rates = np.ones((4, 12))
    with pytest.raises(ValueError, match="2 tables of one kind"):
        write_array_device(tmp_path / "a.yaml", [rates, rates], "ideal", "")
    pairs = read_measurement(ARRAYS / "crosstalk-1.csv")
    with pytest.raises(ValueError, match="no map of dark counts"):
        write_array_device(tmp_path / "a.yaml", [pairs], "ideal", "")
    assert not (tmp_path / "a.yaml").exists()
