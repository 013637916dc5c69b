"""`megalopta check captures` on the measurements that ship and on others."""

import numpy as np
import pytest

from megalopta.cli import main as cli
from megalopta.core.errors import UserError
from megalopta.sensor import Crosstalk, DarkCounts
from megalopta.sensor.calibrate.pair_crosstalk import fit_crosstalk
from megalopta.sensor.effects import crosstalk
from megalopta.sensor.effects.dark_counts import dark_count_density
from megalopta.verification.capture_files import SHIPPED, read_measurement
from megalopta.verification.captures import check_captures


@pytest.fixture(scope="module")
def rows():
    return {path.stem: found for path, found in check_captures().items()}


@pytest.mark.parametrize(("array", "edge"), [(1, 1.03e-3), (2, 9.2e-4)])
def test_crosstalk_of_edge_neighbors_is_the_published_one(array, edge):
    found = fit_crosstalk(read_measurement(SHIPPED / f"crosstalk-{array}.csv"))
    shares = 1 + found.diagonal + found.distance_two + found.distance_three
    # the paper gives two digits
    assert found.mean_fired_neighbors / (4 * shares) == pytest.approx(edge, rel=0.01)


def test_a_table_of_delays_describes_what_an_exponential_misses(rows):
    for capture in ("autocorrelation-1", "autocorrelation-2"):
        z = {row.quantity: row.z for row in rows[capture]}
        assert z["afterpulses at 400 to 800 ns, 1e-3, exponential"] > 3
        assert abs(z["afterpulses at 400 to 800 ns, 1e-3, table"]) < 1


def test_a_simulated_map_shows_the_crosstalk_that_made_it(tmp_path):
    own = dark_count_density(
        DarkCounts(
            bulk_mean_hz_um2=1, bulk_sigma_hz_um2=0.3, hot_fraction=0.1, hot_mean_hz_um2=100
        ),
        (64, 80),
        device_seed=1,
    )
    np.save(tmp_path / "map.npy", crosstalk.mean(own, Crosstalk(mean_fired_neighbors=0.04)))
    found = {
        row.quantity: row for row in check_captures([tmp_path / "map.npy"])[tmp_path / "map.npy"]
    }
    light = found["light of a hot pixel below, even rows, 1e-6, kernel"]
    assert light.measured == pytest.approx(0.01e6, rel=0.1)
    assert (
        abs(found["rank correlation of dark counts with the lower neighbor, kernel subtracted"].z)
        < 5
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty"),
        ("1,2\n3,four", "could not convert"),
        ("1,2\n3,4", "4 rates, of which 24 are needed"),
        ("pix1,pix2,distance,crosstalk,error\n0,1,1,1e-3,1e-5", "1 pairs"),
        ("events,duration_s,1-2\n5,1,3", "1 pixels with events"),
    ],
)
def test_other_files_are_refused_in_a_sentence(tmp_path, text, message):
    path = tmp_path / "other.csv"
    path.write_text(text)
    with pytest.raises(UserError, match=message):
        check_captures([path])


def test_the_command_prints_misfits_and_writes_the_page(tmp_path, capsys):
    page = tmp_path / "captures.html"
    cli.main(["check", "captures", "--page", str(page)])
    assert "beyond the model's" in capsys.readouterr().out
    assert page.read_text("utf-8").count("<svg") == 6
