"""Verbs of stages on a dataset of many sequences."""

import json

import pytest

import megalopta
from megalopta.cli.main import main
from megalopta.core.errors import UserError
from megalopta.dataset.layout import Tree
from megalopta.dataset.store import hashes_of
from megalopta.generation.adding import add_exposures, measure
from megalopta.generation.making import make
from megalopta.verification.files import check_files

from ..small import copied

METHODS = {"methods": "[BM]"}


def responses(root):
    return hashes_of(root, [root / "results"])


@pytest.mark.slow
def test_flow_of_many_is_that_of_each_and_the_same_by_workers(small_dataset, tmp_path):
    roots = [tmp_path / name for name in ("here", "workers")]
    for root, more in zip(roots, ([], ["--workers", "2"]), strict=True):
        copied(small_dataset, root)
        main(["flow", str(root), "--methods", "[BM]", *more])
        assert not check_files(Tree(root))
        for name in Tree(root).names():
            (errors,) = json.loads((root / "results" / name / "flow.json").read_text("utf-8"))[:1]
            assert errors["method"] == "BM"
    assert responses(roots[0]) == responses(roots[1]) != {}


def test_what_is_finished_is_kept_and_other_settings_are_refused(small_copy):
    measure(small_copy, "flow", METHODS)
    before = {path: path.stat().st_mtime_ns for path in small_copy.rglob("results/**/*")}
    measure(small_copy, "flow", METHODS)
    assert {path: path.stat().st_mtime_ns for path in small_copy.rglob("results/**/*")} == before
    with pytest.raises(UserError, match="holds flow output of other settings; add --redo"):
        measure(small_copy, "flow", {"methods": "[LK]"})
    with pytest.raises(UserError, match="would change 'render' output; flow takes only"):
        measure(small_copy, "flow", {"camera.width": "16"})
    measure(small_copy, "flow", {"methods": "[LK]"}, redo=True)
    assert not check_files(Tree(small_copy))


def test_corrected_frames_of_new_exposures_are_on_record_and_others_stay(single_plan, tmp_path):
    calibration = {"frames": 2, "hot_times": 10}
    plan = single_plan.model_copy(
        update={"every": {**single_plan.every, "correct": True, "calibration": calibration}}
    )
    make(tmp_path, plan)
    before = hashes_of(tmp_path, [tmp_path / "corrected"])
    add_exposures(tmp_path, {"sensors": "[spadcam]", "light_levels": "[twilight, full_moon]"})
    assert not check_files(Tree(tmp_path))
    after = hashes_of(tmp_path, [tmp_path / "corrected"])
    assert before.items() < after.items() and before
    (sequence,) = megalopta.open_dataset(tmp_path)
    assert sequence.corrected("spadcam-full_moon")[0].shape == sequence.shape


def test_what_new_exposures_of_moving_light_read_is_compared(single_plan, tmp_path):
    make(tmp_path, single_plan.model_copy(update={"every": {**single_plan.every, "sub_frames": 2}}))
    add_exposures(tmp_path, {"sensors": "[ideal]", "light_levels": "[full_moon]"})
    assert not check_files(Tree(tmp_path))
    (path,) = tmp_path.glob("truth/000000/frame_0002.exr")
    path.write_bytes(bytes(path.stat().st_size))
    with pytest.raises(
        UserError, match=rf"{path} differs from its record; .* check files {tmp_path}$"
    ):
        add_exposures(tmp_path, {"sensors": "[ideal]", "light_levels": "[starlight]"})


def test_damaged_results_are_made_again(small_copy):
    expected = responses(measure(small_copy, "flow", METHODS).root)
    path = small_copy / "results/000000/flow.json"
    path.write_text(path.read_text("utf-8").replace("BM", "MB"), "utf-8")
    measure(small_copy, "flow", METHODS)
    assert responses(small_copy) == expected
    assert not check_files(Tree(small_copy))


def test_sense_report_and_render_take_many_too(small_copy, capsys, refused):
    main(["sense", str(small_copy), "--sensors", "[array-12x4]", "--light_levels", "[starlight]"])
    assert "array-12x4-starlight" in megalopta.open_dataset(small_copy)[0].exposures
    main(["report", str(small_copy)])
    assert capsys.readouterr().out.split() == [
        str(small_copy / n) for n in ("README.md", "index.html")
    ]
    names = Tree(small_copy).names()
    main(["dataset", "make", str(small_copy), "--out", str(small_copy), "--sequences", "4"])
    assert len(Tree(small_copy).names()) == len(names) + 1
    assert not check_files(Tree(small_copy))
    told = refused("render", small_copy, "--out", small_copy, "--redo")
    assert "remove a sequence's record to make it again" in told
