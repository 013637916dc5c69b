"""The benchmark of rendered sequences, through the command line."""

import json

import numpy as np
import pytest

from megalopta.benchmark.findings import findings
from megalopta.benchmark.ranking_errors import STILL
from megalopta.benchmark.ranking_folder import read_ranking, run_ranking
from megalopta.benchmark.ranking_record import BOUND, Ranking
from megalopta.benchmark.ranking_settings import Pooling
from megalopta.benchmark.sequence_truth import SequenceTruth
from megalopta.cli import main as cli
from megalopta.config.model import load
from megalopta.core.errors import UserError
from megalopta.dataset.store import open_sequence
from megalopta.flow.detectors.registry import METHODS
from megalopta.stages.pipeline import run_stage

pytestmark = pytest.mark.slow

SETTINGS = {
    "camera.width": "60",
    "camera.height": "60",
    "trajectory.frames": "8",
    "render.samples_per_pixel": "4",
}
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
    dataset = open_sequence(grating)
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


def test_a_broken_run_goes_on_and_gives_the_same(grating, tmp_path):
    few = {**FEW, "methods": "[BM]", "fluxes": "[1e3, 1e8]"}
    run_ranking(grating, tmp_path, few)
    before = {each: each.read_bytes() for each in tmp_path.glob("ranking.*")}
    kept = sorted((tmp_path / "velocities").rglob("*.npy"))
    assert len(kept) > 2
    times = {each: each.stat().st_mtime_ns for each in kept}
    kept[0].unlink()
    kept[1].write_bytes(kept[1].read_bytes()[:50])
    run_ranking(grating, tmp_path, few)
    assert {each: each.read_bytes() for each in tmp_path.glob("ranking.*")} == before
    again = [each for each in kept if each.stat().st_mtime_ns != times[each]]
    assert again == kept[:2]


@pytest.mark.slow
def test_other_frames_are_measured_anew(tmp_path):
    pages = []
    for seed in ("1", "2"):
        root = tmp_path / seed
        run_stage(root, load("grating", {**SETTINGS, "seed": seed}), "render")
        pages.append(run_ranking(root, tmp_path / "out", {**FEW, "methods": "[BM]"}))
    assert len(list((tmp_path / "out" / "velocities").rglob("*.npy"))) == 2 * 2


@pytest.mark.slow
def test_functions_and_references_are_methods_too(grating, tmp_path, monkeypatch):
    """A module's function and the same function from Python answer alike; other code anew."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine_flow.py").write_text(
        "import numpy as np\ndef flow(a, b):\n    return np.full((*a.shape, 2), [1.0, 0.0])\n"
    )
    run_ranking(grating, "out", FEW, methods=["BM", "mine_flow:flow", still])
    found = errors(tmp_path / "out")
    assert {key[4] for key in found} == {"BM", "mine_flow:flow", "still", STILL, BOUND}
    for group in ("all", "speed medium"):
        if (case := (1, 1, 1e8, group)) + (STILL,) in found:
            mean = found[*case, "still"]["mean"]
            assert mean == pytest.approx(found[*case, STILL]["mean"], abs=1e-12)
    ranking = read_ranking(tmp_path / "out")
    assert ranking.settings.methods == ("BM", "mine_flow:flow", "still")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('{"format": 2}', "ranking format 2 is newer than 1"),
        ("[" * 100_000, "is damaged"),
        ("7", "is damaged"),
        ("{}", "is damaged"),
    ],
)
def test_what_is_no_ranking_of_this_format_is_told(tmp_path, text, told):
    (tmp_path / "ranking.json").write_text(text)
    with pytest.raises(UserError, match=told):
        read_ranking(tmp_path)


def order(group, better, worse, p=1e-6):
    names = {"photons_per_frame": 1e8, "group": group, "better": better, "worse": worse}
    return {**names, "ratio": 1.5, "low": 1.2, "high": 1.9, "p": p}


def best_of(group, method, is_sure=True):
    case = {"pixels": 1, "frames": 1, "photons_per_frame": 1e8}
    return {**case, "group": group, "method": method, "is_sure": is_sure}


def with_blocks(ranked, orders, best=()):
    """A ranking of one sequence with blocks of low and high speed and parallax."""
    record = json.loads((ranked / "ranking.json").read_text())
    groups = ("low parallax", "high parallax", "hidden")
    record["blocks"] = {f"{each}, speed low": 100 for each in groups}
    return Ranking.model_validate({**record, "orders": orders, "best": list(best)})


def test_words_tell_methods_that_change_places(ranked):
    few, much = "low parallax, speed low", "high parallax, speed low"
    orders = [order(few, "BM", "DIS"), order(much, "DIS", "BM")]
    parallax, occlusion, *_ = findings(
        with_blocks(ranked, orders, [best_of(few, "BM"), best_of(much, "DIS")])
    )
    assert parallax == (
        "The order of methods changes with parallax: at 100M photons BM before DIS with 1.50 times "
        "its error, 1.20 to 1.90 (low parallax, speed low), DIS before BM with 1.50 times its error, "
        "1.20 to 1.90 (high parallax, speed low), the best ones."
    )
    assert occlusion == "No change of the order of methods with occlusion is beyond chance."
    assert "best" not in findings(with_blocks(ranked, orders))[0]


@pytest.mark.parametrize("p", [0.06, 0.5])
def test_words_tell_no_change_that_one_group_leaves_open(ranked, p):
    few, much = "low parallax, speed low", "high parallax, speed low"
    orders = [order(few, "BM", "DIS"), order(much, "DIS", "BM", p)]
    assert findings(with_blocks(ranked, orders))[0].startswith("No change of the order")


def test_words_count_how_many_comparisons_there_were(ranked):
    """p of .02 is enough for one comparison, and not for the surest of three (.05 / 3 = .017)."""
    few, much, hidden = (
        f"{each}, speed low" for each in ("low parallax", "high parallax", "hidden")
    )
    one = [order(few, "BM", "DIS"), order(much, "DIS", "BM", 0.02)]
    more = [
        order(hidden, "BM", "DIS"),
        order("smooth", "BM", "DIS"),
        order("depth edge", "BM", "DIS"),
    ]  # with one, the comparisons of hidden blocks and of edges
    assert findings(with_blocks(ranked, one))[0].startswith("The order")
    assert findings(with_blocks(ranked, one + more))[0].startswith("No change")


def test_the_likelihood_tells_the_rotation_better_than_blocks(ranked):
    found = {
        (each.photons_per_frame, each.method): each.rotation_deg
        for each in read_ranking(ranked).camera
    }
    # It turns by 1.5° per frame, a pixel sees 1°. Counts of eight frames know it to .01° at 1e8.
    assert found[1e8, "likelihood, 8 frames"] < 0.05
    assert found[1e8, "likelihood, 2 frames"] < found[1e8, "DIS"] < found[1e8, "BM"]
    assert found[1e3, "likelihood, 8 frames"] < found[1e3, "BM"]
    assert "likelihood, 8 frames" in (ranked / "ranking.html").read_text()


def test_words_say_of_what_they_hold(ranked):
    ranking = with_blocks(ranked, [])
    assert findings(ranking)[-1].startswith("This holds for this sequence alone")
    many = ranking.model_copy(update={"sequences": tuple("abcdef")})
    assert findings(many)[-1].startswith("Intervals are over 6 sequences")


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
        SequenceTruth(open_sequence(each), grid).at(Pooling(1, 1)).groups
        for each in (grating, tmp_path / "plane")
    )
    alone = [name for name in turns if name.startswith("rotation alone")]
    assert sum(turns[name].sum() for name in alone) == (turns["all"] & turns["visible"]).sum() > 0
    assert not any(flies[name].any() for name in alone)
    assert any(flies[f"high parallax, speed {speed}"].any() for speed in ("medium", "high"))


@pytest.mark.slow
def test_yaw_rates_of_methods_with_and_without_velocities(tmp_path):
    """The camera turns at one rate before a grating: clean answers give it within a tenth."""
    words = {**SETTINGS, "trajectory.frames": "30", "render.samples_per_pixel": "1"}
    run_stage(tmp_path / "data", load("grating", words), "render")
    chosen = {**FEW, "fluxes": "[1e3, 1e8]", "methods": "[BM]", "wide_field": "[EMD]"}
    run_ranking(tmp_path / "data", tmp_path, chosen)
    found = {
        (each.photons_per_frame, each.method): each for each in read_ranking(tmp_path).yaw_rates
    }
    assert {name for _, name in found} == {"BM", "EMD"}
    for name in ("BM", "EMD"):
        clean = found[1e8, name]
        assert clean.ideal_deg_s < 0.1 * clean.true_deg_s
        assert clean.counts_deg_s < found[1e3, name].counts_deg_s


def still(first, second):
    return np.zeros((*first.shape, 2))


@pytest.mark.slow
def test_levels_are_measured_at_their_photons(grating, tmp_path):
    """Of a light level in lux: photons per lux and second times lux times exposure."""
    words = {**FEW, "methods": "[BM]", "light_levels": "[twilight, 0.5]", "exposure_s": "0.02"}
    page = run_ranking(grating, tmp_path, words)
    ranking = read_ranking(tmp_path)
    expected = [ranking.photons_per_lux_s * lux * 0.02 for lux in (1.0, 0.5)]
    found = sorted({*ranking.settings.fluxes} - {1e8}, reverse=True)
    assert found == pytest.approx(expected, rel=1e-3)
    text = page.read_text()
    assert "Light levels" in text and "0.5lux" in text and "airglow" in text


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--methods", "EMD"], "'EMD' is no method that gives velocities; choose from BM"),
        (["--methods", "nobody:flow"], "No module named 'nobody'"),
        (["--methods", "none.onnx"], "none.onnx: "),
        (["--wide-field", "NDM"], "'NDM' is blind to direction"),
        (["--light-levels", "noon"], "light level 'noon' is unknown"),
        (["--fluxes", "[]"], "give fluxes, or light_levels"),
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
