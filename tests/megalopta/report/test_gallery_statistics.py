"""Statistics of views, through the door that users take."""

import csv

import numpy as np
import pytest

from megalopta.cli import main
from megalopta.report.gallery_statistics import write_statistics


@pytest.mark.slow
def test_a_photograph_is_measured_beside_forests(picture, tmp_path):
    path = picture(np.random.default_rng(0).random((32, 64, 3)))
    paths = write_statistics(tmp_path / "out", [path], 1, ["open"], 24)
    assert [each.suffix for each in paths] == [".png", ".svg", ".csv", ".json"]
    photograph, forest, blurred = csv.DictReader(paths[2].read_text().splitlines())
    assert (photograph["scene"], forest["scene"]) == (path.stem, "open")
    assert blurred["scene"] == "open, blurred"
    assert float(blurred["gradient_contrast"]) < float(forest["gradient_contrast"])
    assert all(np.isfinite(float(value)) for value in list(photograph.values())[1:])


@pytest.mark.parametrize(
    ("options", "message"),
    [(["--views", "--statistics"], "give one"), (["--panorama", "x.hdr"], "or --statistics")],
)
def test_what_does_not_go_together_is_refused(options, message, tmp_path, capsys):
    with pytest.raises(SystemExit, match="2"):
        main.main(["gallery", *options, "--out", str(tmp_path / "out")])
    assert message in capsys.readouterr().err
