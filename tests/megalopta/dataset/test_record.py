"""Records of strangers, and what is read of a finished sequence compared with its record."""

import copy
import json
import operator
import pickle
from functools import reduce

import pytest

import megalopta
from megalopta.core.errors import UserError
from megalopta.dataset.record import read_record
from megalopta.dataset.store import Tree


@pytest.fixture(scope="module")
def values(single_dataset):
    return json.loads((single_dataset / "sequences/000000.json").read_text())


def told(tmp_path, text):
    path = tmp_path / "000000.json"
    path.write_text(text)
    with pytest.raises(UserError) as problem:
        read_record(path, "000000")
    return str(problem.value)


OTHERS = ("../000000/x", "radiance/000000/../../../x", "radiance/000000//x", "radiance/../000000/x")
NOT_FILES = ("radiance/000001/x", "radiance/000000/", "radiance/000000/a\0b")


@pytest.mark.parametrize(
    ("place", "value", "problem"),
    [
        (["sequence"], "../../x", "it belongs to sequence"),
        (["index"], 7, "index 7 is that of"),
        (["split"], "../../x", "cannot name a split"),
        (["poses"], [[0.0] * 15], "poses.0: "),
        (["stages"], [], "stages"),
        (["stages"], {"x": {"settings": "", "made_with": {}, "version": ""}}, "'x' is not a stage"),
        (["format"], 4, "sequence format 4 is newer than 3"),
        (["statistics", "exposures", 0, "name"], "../../x", "exposures.0.name: "),
        *(
            (["stages", "render", "files"], {name: [1, "00"]}, "not a file of this sequence")
            for name in OTHERS + NOT_FILES
        ),
    ],
)
def test_a_wrong_field_is_told(values, tmp_path, place, value, problem):
    changed = copy.deepcopy(values)
    reduce(operator.getitem, place[:-1], changed)[place[-1]] = value
    assert problem in told(tmp_path, json.dumps(changed))


@pytest.mark.parametrize("text", ["[" * 100_000, "[]", "7", "", '{"a": NaN}', "\ud800 x"])
def test_what_is_no_record_is_told(tmp_path, text):
    path = tmp_path / "000000.json"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    with pytest.raises(UserError, match=r"000000\.json"):
        read_record(path, "000000")


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"configuration": {"name": "000007"}}, "it belongs to '000007'"),
        ({"configuration": {"camera": {"width": -1}}}, r"configuration: camera\.width"),
        ({"poses": []}, None),
        ({"poses": [[0.0] * 16]}, "1 poses of 2 frames"),
    ],
)
def test_settings_that_do_not_fit_the_record_are_refused(single_copy, change, problem):
    path = single_copy / "sequences/000000.json"
    values = json.loads(path.read_text())
    changed = change.get("configuration", {})
    values |= {**change, "configuration": {**values["configuration"], **changed}}
    path.unlink()
    path.write_text(json.dumps(values))
    if problem is None:
        assert Tree(single_copy).opened("000000").sequence == "000000"
        return
    with pytest.raises(UserError, match=problem):
        Tree(single_copy).opened("000000")


def damaged(path):
    """Change a byte in the middle, and leave the size."""
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.unlink()
    path.write_bytes(content)


READS = {
    "radiance/000000/frame_0001.exr": lambda sequence: sequence.radiance[0],
    "truth/000000/frame_0002.exr": lambda sequence: sequence.depth[1],
    "training/flow/000000/frame_0001.flo": lambda sequence: one_pair(sequence)[0],
    "training/occlusions/000000/frame_0001.png": lambda sequence: one_pair(sequence)[0],
    "counts/000000/spadcam-twilight.zarr/counts/c/0/0/0": lambda sequence: sequence.counts()[1],
    "counts/000000/spadcam-twilight.zarr/zarr.json": lambda sequence: sequence.counts(),
}


def one_pair(sequence):
    from megalopta.dataset.opened import FlowPairs

    return FlowPairs([sequence], None, 1)


@pytest.mark.parametrize("name", READS)
def test_reading_a_damaged_file_names_it(single_copy, name):
    sequence = megalopta.open_dataset(single_copy)[0]
    READS[name](sequence)
    damaged(single_copy / name)
    again = megalopta.open_dataset(single_copy)[0]
    with pytest.raises(UserError, match=f"{name} differs from its record; .*check files"):
        READS[name](pickle.loads(pickle.dumps(again)))


def test_what_is_not_read_is_not_compared(single_copy):
    damaged(single_copy / "radiance/000000/frame_0002.exr")
    sequence = megalopta.open_dataset(single_copy)[0]
    assert sequence.radiance[0].shape == (12, 16, 2)
    (single_copy / "truth/000000/frame_0001.exr").unlink()
    with pytest.raises(UserError, match=r"frame_0001\.exr is missing"):
        sequence.depth[0]
