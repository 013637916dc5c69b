"""A dataset made by the command line: foreseen, extended, alone, refused, mended, and in new light."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
import yaml

import megalopta
from megalopta.cli import main
from megalopta.config.drawing import configuration_of
from megalopta.config.recipe import Plan
from megalopta.core.errors import UserError
from megalopta.dataset.layout import Tree
from megalopta.flow.formats import read_flo
from megalopta.generation import making
from megalopta.generation.making import make, parse_indices, write_flow_files
from megalopta.sensor import open_counts
from megalopta.verification.files import check_files

from ..small import counting


def run(*words):
    main.main([*map(str, words)])


def written(folder, plan, changes=()):
    path = folder / "plan.yaml"
    path.write_text(yaml.safe_dump(plan.model_dump(mode="json") | dict(changes)))
    return path


def without_books(root):
    books = {"dataset.yaml", "manifest.jsonl", "croissant.json"}
    return {
        str(path.relative_to(root)): path.read_bytes()
        for path in root.rglob("*")
        if path.is_file()
        and path.name not in books
        and path.parts[len(root.parts)] not in ("index", "splits")
    }


def test_one_sequence_alone_is_that_of_the_whole(small_plan, small_dataset, tmp_path, capsys):
    plan = written(tmp_path, small_plan)
    run("dataset", "make", plan, "--out", tmp_path / "alone", "--only", "1", "--sequences", "1000")
    alone, whole = without_books(tmp_path / "alone"), without_books(small_dataset)
    assert len(alone) > 50
    assert alone == {name: each for name, each in whole.items() if "000001" in name}
    assert Tree(tmp_path / "alone").names() == ["000001"]
    faults = check_files(Tree(tmp_path / "alone"))
    assert ["999 sequences of the plan are missing" in each.what for each in faults] == [True]


def test_more_sequences_leave_what_is_there(small_copy, small_plan):
    before = without_books(small_copy)
    make(small_copy, small_plan.model_copy(update={"sequences": 4}))
    after = without_books(small_copy)
    assert {name: after[name] for name in before} == before
    assert Tree(small_copy).names() == [f"00000{n}" for n in range(4)]
    assert not check_files(Tree(small_copy), truths=4)


def test_a_flow_is_read_once_for_all_its_layouts(single_copy, monkeypatch):
    dataset = replace(megalopta.open_dataset(single_copy)[0].dataset, record=None)
    read = []
    for layout in ("flow_kitti", "flow_flo5"):
        shutil.rmtree(single_copy / "training" / layout)
    monkeypatch.setitem(making.READERS, "training/flow", counting(read_flo, read))
    write_flow_files(dataset, ("kitti_png", "flo5"))
    assert len(read) == len(dataset.configuration.trajectory.times_s) - 1
    assert not check_files(Tree(single_copy))


def test_another_plan_is_refused_with_the_difference(small_copy, small_plan):
    for changes, told in (
        ({"seed": 4}, "seed: 3 → 4"),
        ({"lights": ("daylight",)}, "lights"),
        ({"repeats": 2}, "repeats: 1 → 2"),
    ):
        with pytest.raises(UserError, match=told):
            make(small_copy, small_plan.model_copy(update=changes))


@pytest.mark.slow
def test_a_sequence_that_fails_is_listed_and_retried_alone(small_copy, small_plan):
    # a plan that was checked hardly fails: something is put into the way of one sequence
    blocked = small_copy / ".making" / "000003"
    blocked.parent.mkdir()
    blocked.touch()
    more = small_plan.model_copy(update={"sequences": 5})
    with pytest.raises(UserError, match="1 sequences failed, such as 000003: .*--retry"):
        make(small_copy, more)
    (line,) = (small_copy / "failed.jsonl").read_text().splitlines()
    assert json.loads(line)["index"] == 3
    assert any("lists failed sequences" in fault.what for fault in check_files(Tree(small_copy)))
    blocked.unlink()
    make(small_copy, more, retry=True)
    assert not (small_copy / "failed.jsonl").exists()
    assert not check_files(Tree(small_copy))


@pytest.mark.slow
def test_new_light_on_old_frames(small_copy, small_dataset):
    words = (
        "dataset",
        "expose",
        small_copy,
        "--sensors",
        "ideal",
        "--light-levels",
        "0.5",
        "starlight",
    )
    run(*words, "--repeats", "2")
    added = set(without_books(small_copy)) - set(without_books(small_dataset))
    assert {name.split("/")[0] for name in added} == {"counts"}
    sequence = megalopta.open_dataset(small_copy)[2]
    assert sequence.exposures[2:] == (
        *("ideal-0.5lux", "ideal-starlight", "ideal-r2-0.5lux", "ideal-r2-starlight"),
    )
    first, second = (sequence.counts(f"ideal{r}-0.5lux")[:].astype(float) for r in ("", "-r2"))
    mean = sequence.counts("ideal-0.5lux", "mean_reading")[:]
    # independent Poisson noise: correlation of 2304 pixels below 6 / sqrt(2304), P < 1e-6
    noise = [(each - mean).ravel() / np.sqrt(mean.ravel() + 1e-9) for each in (first, second)]
    assert abs(np.corrcoef(*noise)[0, 1]) < 6 / np.sqrt(len(noise[0]))
    assert not check_files(Tree(small_copy))
    before = without_books(small_copy)
    run(*words, "--repeats", "2")
    assert without_books(small_copy) == before


def test_an_exposure_of_this_name_with_other_settings_is_refused(small_copy, refused):
    level = megalopta.open_dataset(small_copy)[0].configuration.light_levels[0]
    told = refused(
        "dataset", "expose", small_copy, "--sensors", "{preset: spadcam, exposure_s: 0.01}",
        "--light-levels", level,
    )  # fmt: skip
    assert "give the sensor another name" in told


def test_repeats_of_a_plan_are_of_one_device(small_plan, tmp_path):
    plan = small_plan.model_copy(update={"sequences": 1, "repeats": 2, "sensors": ("spadcam",)})
    tree = make(tmp_path / "data", plan)
    stores = sorted((tree.root / "counts/000000").iterdir())
    first, second = (open_counts(store) for store in stores)
    np.testing.assert_array_equal(first["mean_reading"][:], second["mean_reading"][:])
    assert (first["counts"][:] != second["counts"][:]).any()


@pytest.mark.slow
def test_dry_run_tells_and_makes_nothing(small_plan, tmp_path, capsys):
    plan = written(tmp_path, small_plan)
    run("dataset", "make", plan, "--out", tmp_path / "data", "--dry-run", "--sequences", "50")
    told = capsys.readouterr().out
    assert "50 sequences, 150 frames, about" in told
    assert "MB" in told
    assert not (tmp_path / "data").exists()


def test_mistakes_are_told_before_anything_is_made(small_plan, tmp_path, refused):
    for change, told in (
        ({"scenes": ["dmeo"]}, "scenes: 0: preset 'dmeo' is unknown"),
        ({"every": {"camera": {"width": {"uniform": [5, 1]}}}}, "give the lower number first"),
        ({"every": {"camera": {"widht": 5}}}, "did you mean 'width'"),
        ({"lights": ["moon"]}, "light.level"),
        ({"splits": {"a b": 1}}, "cannot name a split"),
    ):
        plan = written(tmp_path, small_plan, change)
        said = refused("dataset", "make", plan, "--out", tmp_path / "data")
        assert told in said
        assert not (tmp_path / "data").exists()


def test_every_kind_of_range_is_drawn_within_its_limits():
    from megalopta.config.drawing import split_of

    plan = Plan(
        scenes=({"preset": "grating", "trajectory": {"rotation_deg_s": {"uniform": [5, 20]}}},),
        every={"camera": {"width": {"integer": [10, 12]}, "height": {"one_of": [8, 16]}}},
        light_levels=({"log_uniform": [0.001, 10]},),
    )
    drawn = [configuration_of(plan, index) for index in range(60)]
    rates = [each.trajectory.rotation_deg_s for each in drawn]
    assert 5 <= min(rates) < 8
    assert 17 < max(rates) <= 20
    assert {each.camera.width for each in drawn} == {10, 11, 12}
    assert {each.camera.height for each in drawn} == {8, 16}
    levels = np.log10([each.light_levels[0] for each in drawn])
    # uniform over four decades: the mean of 60 has a standard error of 0.15, six of which are 0.9
    assert abs(levels.mean() + 1) < 0.9
    assert len({each.seed for each in drawn}) == 60
    assert {split_of(plan, index) for index in range(200)} == set(plan.splits)


def test_a_folder_of_something_else_is_refused(small_plan, tmp_path):
    (tmp_path / "letter.txt").write_text("dear reader")
    with pytest.raises(UserError, match="not a dataset"):
        make(tmp_path, small_plan)
    assert [path.name for path in tmp_path.iterdir()] == ["letter.txt"]


def test_numbers_of_sequences():
    assert parse_indices("7, 0-2", 10) == [0, 1, 2, 7]
    for text, told in (("3-x", "'3-x'"), ("12", "0 to 9"), ("5-3", "0 to 9")):
        with pytest.raises(UserError, match=told):
            parse_indices(text, 10)
