"""The benchmark of rendered sequences, through the command line."""

import numpy as np
import pandas as pd
import pytest

from megalopta.benchmark import ranking as module
from megalopta.benchmark.ranking import BOUND, MEAN, RATIO, STILL, Pooling
from megalopta.benchmark.ranking_page import caution, order_changes
from megalopta.benchmark.ranking_run import read_ranking, run_ranking
from megalopta.benchmark.sequence_errors import SequenceTruth, in_segments
from megalopta.cli import main as cli
from megalopta.config.model import load
from megalopta.core.array_store import ArrayStore
from megalopta.core.errors import UserError
from megalopta.dataset.store import open_sequence
from megalopta.flow.detectors.registry import METHODS
from megalopta.stages.run import run_stage

from ..small import counting, small

pytestmark = pytest.mark.slow

WORDS = "--methods BM DIS --fluxes 1e3 1e8 --repeats 1".split()

NO_POOLING = Pooling(1, 1)
FEW = {
    "fluxes": "[1e8]",
    "repeats": "1",
    "pixels_pooled": "[1]",
    "frames_pooled": "[1]",
}


@pytest.fixture(scope="module")
def grating(tmp_path_factory):
    root = tmp_path_factory.mktemp("ranking") / "grating"
    return run_stage(root, load("grating", small(60, 60, 8, samples=4)), "render").root


@pytest.fixture(scope="module")
def ranked(grating, tmp_path_factory):
    out = tmp_path_factory.mktemp("ranking") / "out"
    cli.main(["benchmark", "sequence", str(grating), "--out", str(out), *WORDS])
    return read_ranking(out)


def error(ranked, method, flux, pooling=NO_POOLING):
    rows = ranked.rows_of(MEAN, Pooling(*pooling))
    return rows[(rows["method"] == method) & (rows["photons"] == flux)]["value"].item()


def test_light_without_much_noise_gives_the_true_motion_and_the_best_method(ranked):
    for pooling in ((1, 1), (1, 2), (2, 1), (2, 2)):
        dis = error(ranked, "DIS", 1e8, pooling=pooling)
        assert dis < 0.2 * error(ranked, STILL, 1e8, pooling=pooling)
        assert dis < error(ranked, "BM", 1e3, pooling=pooling)
        best = ranked.best_of(Pooling(*pooling), 1e8, "all")
        assert best["method"] == "DIS" and best["surely_lowest"]


def test_zero_motion_is_wrong_by_the_true_speed(ranked, grating):
    dataset = open_sequence(grating)
    truth = SequenceTruth(dataset, METHODS["BM"].grid((60, 60))).at(NO_POOLING)
    expected = np.linalg.norm(truth.velocities, axis=-1)[truth.groups["all"]].mean()
    assert error(ranked, STILL, 1e3) == pytest.approx(expected)


def test_the_bound_falls_with_the_root_of_the_photons(ranked):
    """From 1e3 to 1e8 photons by √1e5, but for where the motion itself is less."""
    few, many = (error(ranked, BOUND, flux) for flux in (1e3, 1e8))
    assert few <= many * np.sqrt(1e5) * (1 + 1e-9)
    assert few > 10 * many


def test_a_broken_run_goes_on_and_gives_the_same(grating, tmp_path, monkeypatch):
    few = {**FEW, "methods": "[BM]", "fluxes": "[1e3, 1e5, 1e8]"}
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


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('{"format": 4}', "ranking format 4 is newer than 3"),
        ("[" * 100_000, "missing or damaged"),
        ('{"format": 2}', "older than 3.*regenerate it"),
        ('{"format": 3}', "missing or damaged"),
    ],
)
def test_what_is_no_ranking_of_this_format_is_told(tmp_path, text, told):
    (tmp_path / "ranking.json").write_text(text)
    with pytest.raises(UserError, match=told):
        read_ranking(tmp_path)


FEW_PARALLAX, MUCH_PARALLAX, HIDDEN = (
    f"{each}, speed low" for each in ("low parallax", "high parallax", "hidden")
)


def order(group, better, worse, p=1e-6):
    return RATIO, worse, 1e8, group, 1, 1, 1.5, 1.2, 1.9, False, better, p


def with_orders(ranked, orders):
    """A ranking of one sequence with blocks of low speed, of low and high parallax."""
    blocks = dict.fromkeys((FEW_PARALLAX, MUCH_PARALLAX, HIDDEN), 100)
    facts = ranked.facts.model_copy(update={"blocks": blocks})
    return module.Ranking(facts, pd.DataFrame(orders, columns=module.COLUMNS))


CHANGE = order(FEW_PARALLAX, "BM", "DIS"), order(MUCH_PARALLAX, "DIS", "BM")
OTHERS = [order(group, "BM", "DIS") for group in (HIDDEN, "smooth", "depth edge")]


@pytest.mark.parametrize(
    ("orders", "count"),
    [
        (CHANGE, 1),
        ([CHANGE[0], order(MUCH_PARALLAX, "DIS", "BM", 0.06)], 0),
        # p of .02 is enough for one comparison, and not for the surest of three (.05 / 3 = .017)
        ([CHANGE[0], order(MUCH_PARALLAX, "DIS", "BM", 0.02)], 1),
        ([CHANGE[0], order(MUCH_PARALLAX, "DIS", "BM", 0.02), *OTHERS], 0),
        ([CHANGE[0], order(MUCH_PARALLAX, "BM", "DIS")], 0),
    ],
)
def test_methods_change_places_where_both_groups_say_so_of_all_comparisons(ranked, orders, count):
    said, scope = order_changes(with_orders(ranked, orders))
    assert f"parallax {count}, occlusion 0, depth edges (no such blocks)" in said
    assert "segments of these sequences only" in scope


def test_a_segment_is_some_successive_pairs():
    totals, blocks = np.arange(21.0), np.ones(21)
    rows = list(in_segments("error", "all", totals, blocks, 10))
    assert [row[3] for row in rows[:3]] == [0 + 1 + 2, 3 + 4, 5 + 6]
    assert [sum(values) for values in zip(*(row[3:] for row in rows), strict=True)] == [210, 21]


def test_the_page_warns_of_light_in_which_rendering_noise_counts_more(ranked):
    facts = ranked.facts.model_copy(update={"rendering_photons_per_px": 20.0})
    assert "From 100M photons per frame on" in caution(module.Ranking(facts, ranked.rows))
    quiet = facts.model_copy(update={"rendering_photons_per_px": 1e9})
    assert not caution(module.Ranking(quiet, ranked.rows))


def test_a_camera_that_only_turns_is_told_from_one_that_moves(grating, tmp_path):
    """The grating's camera turns; blocks of a board that is flown past have parallax."""
    moving = {"velocity_m_s": [0, 1, 0], "rotation_deg_s": 0}
    (tmp_path / "plane.yaml").write_text(
        "name: plane\nscene: {kind: plane, pattern: dots}\n"
        "camera: {width: 60, height: 60}\nrender: {samples_per_pixel: 4}\n"
        f"trajectory: {{frames: 8, frame_rate_hz: 10, {str(moving)[1:-1]}}}\n".replace("'", "")
    )
    run_stage(tmp_path / "plane", load(str(tmp_path / "plane.yaml")), "render")
    grid = METHODS["BM"].grid((60, 60))
    turns, flies = (
        SequenceTruth(open_sequence(each), grid).at(NO_POOLING).groups
        for each in (grating, tmp_path / "plane")
    )
    alone = [name for name in turns if name.startswith("rotation alone")]
    assert sum(turns[name].sum() for name in alone) == (turns["all"] & turns["visible"]).sum() > 0
    assert not any(flies[name].any() for name in alone)
    assert any(flies[f"high parallax, speed {speed}"].any() for speed in ("medium", "high"))


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--methods", "EMD"], "EMD measures no velocity: choose from BM"),
        (["--methods", "nobody:flow"], "No module named 'nobody'"),
        (["--light-levels", "noon"], "light level 'noon' is unknown"),
        (["--fluxes", "[]"], "give fluxes, or light_levels"),
        (["--pixels-pooled", "30"], "pixels_pooled 30 for BM"),
        (["--frames-pooled", "4"], "has 8 frames: frames_pooled 4 needs 12"),
    ],
)
def test_mistakes_get_one_sentence(grating, tmp_path, refused, words, told):
    assert told in refused("benchmark", "sequence", grating, "--out", tmp_path / "o", *words)
