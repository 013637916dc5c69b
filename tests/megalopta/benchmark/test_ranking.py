"""The benchmark of rendered sequences, through the command line."""

import numpy as np
import pandas as pd
import pytest

from megalopta.benchmark.curves import BOUND, STILL
from megalopta.benchmark.ranking import Ranking, RankingFacts
from megalopta.benchmark.ranking_page import below_bound, caution
from megalopta.benchmark.ranking_run import perfect_light, run_ranking, sequence_truth
from megalopta.benchmark.table import MEAN
from megalopta.cli import main as cli
from megalopta.config.model import load
from megalopta.core.array_store import ArrayStore
from megalopta.dataset.store import open_sequence
from megalopta.flow.detectors.registry import METHODS
from megalopta.stages.run import run_stage

from ..small import counting, small

pytestmark = pytest.mark.slow

WORDS = "--methods BM DIS --fluxes 1e3 1e8 --repeats 1".split()


@pytest.fixture(scope="module")
def grating(tmp_path_factory):
    root = tmp_path_factory.mktemp("ranking") / "grating"
    return run_stage(root, load("grating", small(60, 60, 8, samples=4)), "render").root


@pytest.fixture(scope="module")
def ranked(grating, tmp_path_factory):
    out = tmp_path_factory.mktemp("ranking") / "out"
    cli.main(["benchmark", "sequence", str(grating), "--out", str(out), *WORDS])
    facts = RankingFacts.model_validate_json((out / "ranking.json").read_text())
    return Ranking(facts, pd.read_csv(out / "ranking.csv"))


def error(ranked, method, flux):
    rows = ranked.rows_of(MEAN)
    return rows[(rows["method"] == method) & (rows["photons"] == flux)]["value"].item()


def test_light_without_much_noise_gives_the_true_motion_and_the_best_method(ranked):
    dis = error(ranked, "DIS", 1e8)
    assert dis < 0.2 * error(ranked, STILL, 1e8)
    assert dis < error(ranked, "BM", 1e3)
    best = ranked.best().set_index("photons").loc[1e8]
    assert best["method"] == "DIS" and best["surely_lowest"]


def test_zero_motion_is_wrong_by_the_true_speed(ranked, grating):
    truth = sequence_truth(open_sequence(grating), METHODS["BM"].grid((60, 60)))
    expected = np.linalg.norm(truth.velocities, axis=-1)[truth.groups["all"]].mean()
    assert error(ranked, STILL, 1e3) == pytest.approx(expected)


def test_zero_as_a_method_is_the_baseline_itself_and_pixels_are_the_unit_of_photons(
    ranked, grating, tmp_path, capsys
):
    words = "--methods BM zero --against dis --photons 10 --repeats 2 --out".split()
    cli.main(["benchmark", "sequence", str(grating), *words, str(tmp_path)])
    facts = RankingFacts.model_validate_json((tmp_path / "ranking.json").read_text())
    again = Ranking(facts, pd.read_csv(tmp_path / "ranking.csv"))
    assert error(again, STILL, 36000) == pytest.approx(error(ranked, STILL, 1e3))
    assert facts.blocks == ranked.facts.blocks
    said = capsys.readouterr().out
    assert "photons per pixel: 10 " in said and "DIS (± 95 % CI, paired)" in said
    by_sequence = pd.read_csv(tmp_path / "ranking-sequences.csv").query("group == 'all'")
    mean = by_sequence.query("metric == @MEAN and method == 'DIS'")
    assert set(mean["sequence"]) == {facts.sequences[0]} and len(mean) > 3
    total = (mean["value"] * mean["blocks"]).sum() / mean["blocks"].sum()
    assert total == pytest.approx(error(again, "DIS", 36000))


def test_methods_below_the_bound_are_named(ranked):
    for error, told in ((9.0, ""), (0.0, "Below the Poisson bound: BM, DIS. The ")):
        is_bound = ranked.rows["method"].isin([BOUND, STILL])
        rows = ranked.rows.assign(value=ranked.rows["value"].where(is_bound, error))
        assert below_bound(Ranking(ranked.facts, rows))[: len(told) or 1] == told


def test_the_bound_falls_with_the_root_of_the_photons(ranked):
    """From 1e3 to 1e8 photons by √1e5, but for where the motion itself is less."""
    few, many = (error(ranked, BOUND, flux) for flux in (1e3, 1e8))
    assert few <= many * np.sqrt(1e5) * (1 + 1e-9)
    assert few > 10 * many


def test_a_broken_run_goes_on_and_gives_the_same(grating, tmp_path, monkeypatch):
    few = {"methods": "[BM]", "fluxes": "[1e3, 1e5, 1e8]", "repeats": "1"}
    run_ranking(grating, tmp_path, few)
    before = {each: each.read_bytes() for each in tmp_path.glob("ranking.*")}
    kept = sorted((tmp_path / "velocities").rglob("*.npz"))
    assert len(kept) > 2
    kept[0].unlink()
    kept[1].write_bytes(kept[1].read_bytes()[:50])
    monkeypatch.setattr(ArrayStore, "write", counting(ArrayStore.write, written := []))
    run_ranking(grating, tmp_path, few)
    assert {each: each.read_bytes() for each in tmp_path.glob("ranking.*")} == before
    assert len(written) == 2


def test_a_board_that_is_flown_past_has_parallax_and_a_camera_that_turns_has_none(
    grating, tmp_path
):
    moving = "velocity_m_s: [0, 1, 0], rotation_deg_s: 0"
    (tmp_path / "plane.yaml").write_text(
        "name: plane\nscene: {kind: plane, pattern: dots}\n"
        "camera: {width: 60, height: 60}\nrender: {samples_per_pixel: 4}\n"
        f"trajectory: {{frames: 8, frame_rate_hz: 10, {moving}}}\n"
    )
    run_stage(tmp_path / "plane", load(str(tmp_path / "plane.yaml")), "render")
    grid = METHODS["BM"].grid((60, 60))
    turns, flies = (
        sequence_truth(open_sequence(root), grid).groups for root in (grating, tmp_path / "plane")
    )
    assert (turns["parallax low"] == turns["all"]).all() and turns["all"].any()
    assert (flies["parallax high"] | flies["parallax medium"]).any()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--methods", "EMD"], "EMD measures no velocity: choose from BM"),
        (["--methods", "nobody:flow"], "No module named 'nobody'"),
        (["--fluxes", "[]"], "give fluxes, or light_levels"),
    ],
)
def test_mistakes_get_one_sentence(grating, tmp_path, refused, words, told):
    assert told in refused("benchmark", "sequence", grating, "--out", tmp_path / "o", *words)


def test_lights_in_which_rendering_noise_rivals_shot_noise_are_marked(grating, tmp_path, capsys):
    """Against the difference of two independent renderings."""
    given = load("grating", small(60, 60, 8, samples=4) | {"seed": "7"})
    other = run_stage(tmp_path / "other", given, "render")
    both = np.stack([perfect_light(dataset) for dataset in (open_sequence(grating), other)])
    both /= both.mean()
    equal = 2 * both.mean() / np.mean((both[0] - both[1]) ** 2)  # photons per pixel
    dim, bright = (f"{times * equal * 60 * 60:.4g}" for times in (0.05, 0.2))
    words = ["--methods", "BM", "--repeats", "1", "--fluxes", dim, bright]
    cli.main(["benchmark", "sequence", str(grating), "--out", str(tmp_path), *words])
    facts = RankingFacts.model_validate_json((tmp_path / "ranking.json").read_text())
    assert facts.noisy_fluxes == [float(bright)]
    rows = pd.read_csv(tmp_path / "ranking.csv")
    shares = rows.groupby("photons")["rendering_noise"].first()
    np.testing.assert_allclose(shares, (0.05, 0.2), rtol=0.25)
    told, page = capsys.readouterr().err, (tmp_path / "ranking.html").read_text("utf-8")
    assert "rendering noise, which no camera has" in told and "Give lower --fluxes" in told
    assert caution(facts) in page and page.count(" *<br>") == 4  # of four tables
