"""The benchmark of rendered sequences, through the command line."""

import json

import numpy as np
import pytest

from megalopta.benchmark.block_truths import SequenceTruth
from megalopta.benchmark.ranking import RATIO, Ranking
from megalopta.benchmark.ranking_page import order_changes
from megalopta.benchmark.ranking_run import read_ranking, run_ranking
from megalopta.benchmark.ranking_settings import NO_POOLING
from megalopta.benchmark.sequence_errors import BOUND, STILL
from megalopta.cli import main as cli
from megalopta.config.model import load
from megalopta.core.array_store import ArrayStore
from megalopta.core.errors import UserError
from megalopta.dataset.store import open_sequence
from megalopta.flow.detectors.registry import METHODS
from megalopta.stages.run import run_stage

from ..small import counting, small

pytestmark = pytest.mark.slow

WORDS = "--methods BM DIS --fluxes 1e3 1e8 --repeats 1 --camera-pairs 1".split()

FEW = {
    "fluxes": "[1e8]",
    "repeats": "1",
    "pixels_pooled": "[1]",
    "frames_pooled": "[1]",
    "camera_pairs": "0",
    "wide_field": "[]",
}


@pytest.fixture(scope="module")
def grating(tmp_path_factory):
    root = tmp_path_factory.mktemp("ranking") / "grating"
    return run_stage(root, load("grating", small(60, 60, 8, samples=4)), "render").root


@pytest.fixture(scope="module")
def ranked(grating, tmp_path_factory):
    out = tmp_path_factory.mktemp("ranking") / "out"
    cli.main(["benchmark", "sequence", str(grating), "--out", str(out), *WORDS])
    return out


def error(ranked, method, flux, group="all", pooling=NO_POOLING):
    return read_ranking(ranked).error_of(pooling, flux, group, method).value


def test_light_without_much_noise_gives_the_true_motion_and_the_best_method(ranked):
    for pooling in ((1, 1), (1, 2), (2, 1), (2, 2)):
        dis = error(ranked, "DIS", 1e8, pooling=pooling)
        assert dis < 0.2 * error(ranked, STILL, 1e8, pooling=pooling)
        assert dis < error(ranked, "BM", 1e3, pooling=pooling)
        best = read_ranking(ranked).best_of(pooling, 1e8, "all")
        assert (best.method, best.value) == ("DIS", 1)


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
    few = {**FEW, "methods": "[BM]", "fluxes": "[1e3, 1e8]"}
    run_ranking(grating, tmp_path, few)
    assert "Camera motion" not in (tmp_path / "ranking.html").read_text("utf-8")
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
        ('{"format": 3}', "ranking format 3 is newer than 2"),
        ("[" * 100_000, "missing or damaged"),
        ('{"format": 1}', "older than 2.*regenerate it"),
        ('{"format": 2}', "missing or damaged"),
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
    case = {"metric": RATIO, "photons_per_frame": 1e8, "group": group, "pixels_pooled": 1}
    numbers = {"value": 1.5, "low": 1.2, "high": 1.9, "p": p}
    return {**case, "frames_pooled": 1, "method": worse, "against": better, **numbers}


def with_orders(ranked, *orders):
    """A ranking of one sequence with blocks of low speed, of low and high parallax."""
    record = json.loads((ranked / "ranking.json").read_text())
    record["blocks"] = dict.fromkeys((FEW_PARALLAX, MUCH_PARALLAX, HIDDEN), 100)
    return Ranking.model_validate({**record, "rows": orders})


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
    said, scope = order_changes(with_orders(ranked, *orders))
    assert f"parallax {count}, occlusion 0, depth edges (no such blocks)" in said
    assert "segments of these sequences only" in scope


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
        (["--wide-field", "NDM"], "'NDM' is blind to direction"),
        (["--light-levels", "noon"], "light level 'noon' is unknown"),
        (["--fluxes", "[]"], "give fluxes, or light_levels"),
        (["--pixels-pooled", "30"], "pixels_pooled 30 for BM"),
        (["--frames-pooled", "4"], "has 8 frames: frames_pooled 4 needs 12"),
    ],
)
def test_mistakes_get_one_sentence(grating, tmp_path, refused, words, told):
    assert told in refused("benchmark", "sequence", grating, "--out", tmp_path / "o", *words)
