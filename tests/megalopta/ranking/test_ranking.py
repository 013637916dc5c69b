"""The benchmark of rendered sequences, through the command line."""

import json

import numpy as np
import pytest

from megalopta.cli import main as cli
from megalopta.config import load
from megalopta.dataset import open_dataset
from megalopta.flow.detectors import METHODS
from megalopta.ranking import BOUND, STILL, Pooling
from megalopta.ranking.truth import SequenceTruth
from megalopta.stages import run_stage

SETTINGS = {
    "camera.width": "60",
    "camera.height": "60",
    "trajectory.frames": "8",
    "render.samples_per_pixel": "4",
}
WORDS = "--methods BM DIS --fluxes 1e3 1e8 --repeats 1 --camera-pairs 1".split()


@pytest.fixture(scope="module")
def grating(tmp_path_factory):
    root = tmp_path_factory.mktemp("ranking") / "grating"
    run_stage(root, load("grating", SETTINGS), "render")
    return root


@pytest.fixture(scope="module")
def ranked(grating, tmp_path_factory):
    out = tmp_path_factory.mktemp("ranking") / "out"
    cli.main(["benchmark", "sequence", str(grating), "--out", str(out), *WORDS])
    return out


def errors(ranked):
    rows = json.loads((ranked / "ranking.json").read_text())["errors"]
    return {
        (row["pixels"], row["frames"], row["photons_per_frame"], row["group"], row["method"]): row
        for row in rows
    }


def test_light_without_much_noise_gives_the_true_motion(ranked):
    found = errors(ranked)
    for pooling in ((1, 1), (1, 2), (2, 1), (2, 2)):
        dis = found[(*pooling, 1e8, "all", "DIS")]["mean"]
        still = found[(*pooling, 1e8, "all", STILL)]["mean"]
        assert dis < 0.2 * still
        assert found[(*pooling, 1e3, "all", "BM")]["mean"] > dis


def test_still_is_wrong_by_the_true_speed(ranked, grating):
    dataset = open_dataset(grating)
    truth = SequenceTruth(dataset, METHODS["BM"].grid((60, 60))).at(Pooling(1, 1))
    expected = np.linalg.norm(truth.velocities, axis=-1)[truth.groups["all"]].mean()
    assert errors(ranked)[1, 1, 1e3, "all", STILL]["mean"] == pytest.approx(expected)


def test_the_bound_falls_with_the_root_of_the_photons(ranked):
    """From 1e3 to 1e8 photons by √1e5, but for where the motion itself is less."""
    found = errors(ranked)
    few, many = (found[1, 1, flux, "all", BOUND]["mean"] for flux in (1e3, 1e8))
    assert few <= many * np.sqrt(1e5) * (1 + 1e-9)
    assert few > 10 * many


def test_the_page_says_and_shows(ranked):
    page = (ranked / "ranking.html").read_text()
    for word in ("Lowest mean error", "Where the ranking changes", "Atlas", "<svg", "DIS"):
        assert word in page
    assert "http" not in page.replace("http://www.w3.org", "")
    assert (ranked / "ranking.csv").read_text().startswith("pixels_pooled,")


def test_a_broken_run_goes_on_and_gives_the_same(ranked, grating, capsys):
    before = {each: each.read_bytes() for each in ranked.glob("ranking.*")}
    kept = sorted((ranked / "velocities").rglob("*.npy"))
    times = {each: each.stat().st_mtime_ns for each in kept}
    kept[0].unlink()
    kept[1].write_bytes(kept[1].read_bytes()[:50])
    cli.main(["benchmark", "sequence", str(grating), "--out", str(ranked), *WORDS])
    assert {each: each.read_bytes() for each in ranked.glob("ranking.*")} == before
    again = [each for each in kept if each.stat().st_mtime_ns != times[each]]
    assert again == kept[:2]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--methods", "EMD"], "'EMD' is no method that gives velocities; choose from BM"),
        (["--fluxes", "0"], "fluxes"),
        (["--pixels-pooled", "30"], "pixels_pooled 30 for BM"),
        (["--frames-pooled", "4"], "has 8 frames: frames_pooled 4 needs 12"),
    ],
)
def test_mistakes_get_one_sentence(grating, tmp_path, capsys, words, told):
    with pytest.raises(SystemExit) as end:
        cli.main(["benchmark", "sequence", str(grating), "--out", str(tmp_path / "o"), *words])
    assert end.value.code == 2
    text = capsys.readouterr().err
    assert told in text
    assert "Traceback" not in text
