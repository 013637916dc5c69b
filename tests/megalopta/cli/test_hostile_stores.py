"""Stores of a stranger's dataset or recording, whose hashes agree: no verb runs what is in them."""

import json
import shutil

import pytest
import zarr

from ..harm import as_format_2
from ..small import agreeing

COUNTS, RESPONSES = "counts/grating", "results/grating/responses"


VERBS = {
    "check": ("check", "files", "{root}"),
    "view": ("view", "{root}", "--out", "{out}"),
    "report": ("report", "{root}"),
    "flow": ("flow", "{root}", "--redo"),
    "submit": ("benchmark", "submit", "DIS", "--truth", "{root}", "--out", "{out}"),
}


@pytest.mark.parametrize("verb", ["check", *(pytest.param(verb, marks=pytest.mark.slow) for verb in ("view", "report", "flow"))])  # fmt: skip
@pytest.mark.parametrize("place", [COUNTS, RESPONSES])
def test_a_store_of_format_2_runs_nothing(whole_copy, tmp_path, capsys, run, verb, place):
    for store in sorted((whole_copy / place).glob("*.zarr")):
        as_format_2(store, tmp_path / "ran")
    agreeing(whole_copy)
    words = [word.format(root=whole_copy, out=tmp_path / "out") for word in VERBS[verb]]
    code, told = run(words), capsys.readouterr()
    assert not (tmp_path / "ran").exists()
    assert "Traceback" not in told.err + told.out
    overwritten = verb == "flow" and place == RESPONSES
    assert code in ((0,) if overwritten else (1, 2)), told
    assert overwritten or "format 2" in told.err + told.out


def flip(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


@pytest.mark.parametrize(
    "damage",
    [
        lambda root: flip(root / "training/flow/grating/frame_0002.flo"),
        lambda root: (root / "training/flow/grating/frame_0002.flo").unlink(),
        lambda root: (root / "training/clean/grating/frame_0002.png").unlink(),
        lambda root: flip(root / "training/occlusions/grating/frame_0001.png"),
        lambda root: shutil.rmtree(root / "training/invalid/grating"),
    ],
    ids=["flipped flow", "deleted flow", "deleted picture", "flipped mask", "deleted masks"],
)
@pytest.mark.parametrize("part", ["", "training"])
def test_damaged_truth_scores_nothing(whole_copy, tmp_path, refused, damage, part):
    damage(whole_copy)
    words = "benchmark", "submit", "DIS", "--truth", whole_copy / part
    said = refused(*words, "--out", tmp_path / "scores.json")
    assert said.count("\n") == 1
    assert not (tmp_path / "scores.json").exists()


@pytest.mark.parametrize("verb", ["view", *(pytest.param(verb, marks=pytest.mark.slow) for verb in ("report", "flow"))])  # fmt: skip
def test_a_store_larger_than_its_dataset_is_not_read(whole_copy, tmp_path, refused, verb):
    for store in sorted((whole_copy / COUNTS).glob("*.zarr")):
        for folder in sorted(path for path in store.iterdir() if path.is_dir()):
            kind = json.loads((folder / "zarr.json").read_text("utf-8"))
            shutil.rmtree(folder)
            zarr.create_array(
                folder, shape=(4, 9000, 9000), chunks=(1, 9000, 9000), dtype=kind["data_type"],
                attributes=kind["attributes"], config={"write_empty_chunks": True},
            )[:1] = 0  # fmt: skip
            first = folder / "c/0/0/0"
            for number in (1, 2, 3):
                (folder / f"c/{number}/0").mkdir(parents=True)
                shutil.copy(first, folder / f"c/{number}/0/0")
    agreeing(whole_copy)
    words = [word.format(root=whole_copy, out=tmp_path / "out") for word in VERBS[verb]]
    assert "instead of (4, 24, 32)" in refused(*words)
