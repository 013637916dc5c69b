"""Verbs of stages on a dataset of many sequences."""

import json
import os
import shutil

import pytest

import megalopta
from megalopta.cli.main import main
from megalopta.core.errors import UserError
from megalopta.dataset.layout import Tree
from megalopta.dataset.store import hashes_of
from megalopta.generation.adding import add_exposures, measure
from megalopta.generation.making import make
from megalopta.verification.files import check_files

METHODS = {"methods": "[BM]"}


@pytest.fixture
def copy(small_dataset, tmp_path):
    target = tmp_path / "data"
    return shutil.copytree(small_dataset, target, symlinks=True, copy_function=os.link)


def responses(root):
    return hashes_of(root, [root / "results"])


@pytest.mark.slow
def test_flow_of_many_is_that_of_each_and_the_same_by_workers(small_dataset, tmp_path):
    roots = [tmp_path / name for name in ("here", "workers")]
    for root, more in zip(roots, ([], ["--workers", "2"]), strict=True):
        shutil.copytree(small_dataset, root, symlinks=True, copy_function=os.link)
        main(["flow", str(root), "--methods", "[BM]", *more])
        assert not check_files(Tree(root))
        for name in Tree(root).names():
            (errors,) = json.loads((root / "results" / name / "flow.json").read_text("utf-8"))[:1]
            assert errors["method"] == "BM"
    assert responses(roots[0]) == responses(roots[1]) != {}


def test_what_is_finished_is_kept_and_other_settings_are_refused(copy):
    measure(copy, "flow", METHODS)
    before = {path: path.stat().st_mtime_ns for path in copy.rglob("results/**/*")}
    measure(copy, "flow", METHODS)
    assert {path: path.stat().st_mtime_ns for path in copy.rglob("results/**/*")} == before
    with pytest.raises(UserError, match="holds flow output of other settings; add --redo"):
        measure(copy, "flow", {"methods": "[LK]"})
    with pytest.raises(UserError, match="would change 'render' output; flow takes only"):
        measure(copy, "flow", {"camera.width": "16"})
    measure(copy, "flow", {"methods": "[LK]"}, redo=True)
    assert not check_files(Tree(copy))


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


def test_damaged_results_are_made_again(copy):
    expected = responses(measure(copy, "flow", METHODS).root)
    path = copy / "results/000000/flow.json"
    path.write_text(path.read_text("utf-8").replace("BM", "MB"), "utf-8")
    measure(copy, "flow", METHODS)
    assert responses(copy) == expected
    assert not check_files(Tree(copy))


def test_sense_report_and_render_take_many_too(copy, capsys, refused):
    main(["sense", str(copy), "--sensors", "[array-12x4]", "--light_levels", "[starlight]"])
    assert "array-12x4-starlight" in megalopta.open_dataset(copy)[0].exposures
    main(["report", str(copy)])
    assert capsys.readouterr().out.split() == [str(copy / n) for n in ("README.md", "index.html")]
    names = Tree(copy).names()
    main(["render", str(copy), "--out", str(copy), "--sequences", "4"])
    assert len(Tree(copy).names()) == len(names) + 1
    assert not check_files(Tree(copy))
    told = refused("render", copy, "--out", copy, "--redo")
    assert "remove a sequence's record to make it again" in told
