"""Records of strangers: names that lead out, wrong numbers, other formats."""

import json

import pytest

from megalopta.core.errors import UserError
from megalopta.dataset.layout import Tree
from megalopta.dataset.record import STAGE_NAMES, read_record
from megalopta.stages.registry import STAGES


@pytest.fixture(scope="module")
def values(single_dataset):
    return json.loads((single_dataset / "sequences/000000.json").read_text())


def told(tmp_path, text):
    path = tmp_path / "000000.json"
    path.write_text(text)
    with pytest.raises(UserError) as problem:
        read_record(path, "000000")
    return str(problem.value)


@pytest.mark.parametrize(
    "name",
    [
        "../000000/x",
        "radiance/000000/../../../x",
        "radiance/000000//x",
        "radiance/../000000/x",
        "radiance/000001/x",
        "radiance/000000/",
        "radiance/000000/a\0b",
    ],
)
def test_files_that_are_not_the_sequences_own_are_refused(values, tmp_path, name):
    stages = {**values["stages"]}
    stages["render"] = {**stages["render"], "files": {name: [1, "00"]}}
    assert "no file of this sequence" in told(tmp_path, json.dumps({**values, "stages": stages}))


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"sequence": "../../x"}, "it is of sequence"),
        ({"index": 7}, "index 7 is of sequence"),
        ({"index": -1}, "index"),
        ({"split": "../../x"}, "cannot name a split"),
        ({"poses": [[0.0] * 15]}, "a pose is a matrix of 16 numbers"),
        ({"stages": []}, "stages"),
        ({"stages": {"x": {"settings": "", "made_with": {}, "version": ""}}}, "'x' is no stage"),
        ({"statistics": None}, "lacks"),
        ({"stages": {"sense": {"settings": "", "made_with": {}, "version": ""}}}, "lacks"),
        ({"format": 3}, "sequence format 3 is newer than 2"),
        ({"format": 1}, "sequence format 1 is older than 2"),
        ({"format": "x"}, "not a format number"),
    ],
)
def test_a_wrong_field_is_told(values, tmp_path, change, problem):
    assert problem in told(tmp_path, json.dumps({**values, **change}))


def test_exposures_have_names_of_files(values, tmp_path):
    statistics = values["statistics"]
    exposure = {**statistics["exposures"][0], "name": "../../x"}
    changed = {**values, "statistics": {**statistics, "exposures": [exposure]}}
    assert "cannot name an exposure" in told(tmp_path, json.dumps(changed))


@pytest.mark.parametrize("text", ["[" * 100_000, "[]", "7", "", '{"a": NaN}', "\ud800 x"])
def test_what_is_no_record_is_told(tmp_path, text):
    path = tmp_path / "000000.json"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    with pytest.raises(UserError, match=r"000000\.json"):
        read_record(path, "000000")


def test_settings_of_another_sequence_are_refused(single_dataset, values):
    tree = Tree(single_dataset)
    record = tree.record("000000")
    for change, problem in (
        ({"name": "000007"}, "it is of '000007'"),
        ({"camera": {"kind": "perspective", "width": -1}}, "configuration: camera.width"),
    ):
        configuration = {**record.configuration, **change}
        with pytest.raises(UserError, match=problem):
            tree.dataset(record.model_copy(update={"configuration": configuration}))
    with pytest.raises(UserError, match="0 poses of 2 frames"):
        tree.dataset(record.model_copy(update={"poses": ()}))


def test_names_of_stages_are_those_that_there_are():
    assert tuple(STAGES) == STAGE_NAMES
