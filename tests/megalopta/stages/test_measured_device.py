"""Measured devices through the command line."""

import os
import pickle
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from megalopta.cli import main as cli
from megalopta.config.model import load
from megalopta.dataset.store import open_sequence
from megalopta.sensor import open_counts
from megalopta.stages.run import run_stage

from ..small import TINY, content

EXAMPLE = Path(__file__).parents[3] / "docs/example_device"
SHAPE = (40, 48)


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    root = tmp_path_factory.mktemp("rendered") / "data"
    short = load("grating", {**TINY, "trajectory.frames": "3"})
    return run_stage(root, short, "render").root


@pytest.fixture
def folder(rendered, tmp_path, monkeypatch):
    """The working folder: a rendered dataset, a device and its dark counts."""
    shutil.copytree(rendered, tmp_path / "data")
    np.save(tmp_path / "dark.npy", np.ones((50, 50)))
    write(tmp_path, {"dark_counts": {"path": "dark.npy"}, "fit": "center"})
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write(folder, measured, **changes):
    device = {"preset": "spadcam", "name": "mine", "measured": measured, **changes}
    (folder / "device.yaml").write_text(yaml.safe_dump(device))


DEVICE = "sense", "data", "--sensors", "[device.yaml]", "--light-levels", "1e-9"


def sense():
    cli.main([*DEVICE])


def counts(root):
    return open_counts(next((root / "counts/grating").iterdir())).exposure()


def test_the_example_device_is_sensed_with_the_middle_of_its_maps(folder, capsys):
    level = ["--light-levels", "1e-9"]  # so dark that only dark counts remain
    cli.main(["sense", "data", "--sensors", str(EXAMPLE / "device.yaml"), *level])
    assert "count nothing" not in capsys.readouterr().err
    dark_hz = np.load(EXAMPLE / "dark_counts_hz.npy")[44:84, 40:88]
    expected = counts(folder / "data").expectation.mean_events
    short = str({"preset": str(EXAMPLE / "device.yaml"), "name": "short", "exposure_s": 1e-5})
    cli.main(["sense", "data", "--redo", "--sensors", f"[{short}]", *level])
    assert "% of pixels count nothing in 10 µs; add light" in capsys.readouterr().err
    # a paralyzable dead time of 1 µs; at its ends an exposure loses less, by 1e-5
    np.testing.assert_allclose(expected[0], 0.1 * dark_hz * np.exp(-1e-6 * dark_hz), rtol=1e-4)


def test_the_dataset_describes_the_device_without_its_yaml_and_curve(folder, monkeypatch):
    (folder / "pde.csv").write_text("400,0.1\n700,0.2\n")
    maps = {"dark_counts": "dark.npy", "fit": "top_left"}
    write(folder, maps, efficiency={"path": "pde.csv"})
    sense()
    before = content(folder / "data")
    for name in ("device.yaml", "pde.csv"):
        (folder / name).unlink()
    (sensor,) = open_sequence(folder / "data").configuration.sensors
    assert sensor.measured.dark_counts.path == str(folder / "dark.npy")
    assert sensor.efficiency.values == (0.1, 0.2)
    monkeypatch.chdir(os.sep)
    cli.main(["sense", str(folder / "data")])
    assert content(folder / "data") == before
    cli.main(["sense", str(folder / "data"), "--redo"])
    assert content(folder / "data") == before


def bytes_of(values, **options):
    np.save("x.npy", values, **options)
    return Path("x.npy").read_bytes()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: bytes_of(np.ones((50, 50))), r"has 50 × 50, the image 40 × 48 .*set measured.fit"),
        (lambda: bytes_of(np.ones((16, 16))), "has 16 × 16, the image 40 × 48 .*lower camera"),
        (lambda: bytes_of(np.full(SHAPE, 1e30)), "in Hz: .* in the worst pixel"),
        (lambda: pickle.dumps(np.ones(SHAPE)), "plain numbers"),
    ],
)
def test_a_bad_map_is_refused_before_anything_is_removed(folder, refused, make, message):
    sense()
    before = content(folder / "data")
    (folder / "dark.npy").write_bytes(make())
    write(folder, {"dark_counts": {"path": "dark.npy"}})
    said = refused(*DEVICE, "--redo")
    assert said.startswith("megalopta: sense: sensor 'mine': ") or "device.yaml" in said
    assert re.search(message, said) and said.count("\n") == 1 and "MapFile" not in said, said
    assert content(folder / "data") == before
