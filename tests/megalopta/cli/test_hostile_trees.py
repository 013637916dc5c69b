"""Datasets of strangers under every verb that reads them: one sentence, no hang, nothing outside."""

import json
import shutil

import pytest

from ..harm import link, pipe, text
from ..small import content, copied

VERBS = {
    "check": ("dataset", "check"),
    "card": ("dataset", "card"),
    "view": ("dataset", "view"),
    "expose": ("dataset", "expose", "--sensors", "ideal"),
    "benchmark": ("benchmark", "sequence"),
}


def table_elsewhere(root, outside):
    path = root / "croissant.json"
    described = json.loads(path.read_text())
    for part in described["distribution"]:
        part["contentUrl"] = "/dev/zero"
    text("croissant.json", json.dumps(described))(root, outside)


def flipped(name):
    """One bit in a word of a description."""

    def put(root, outside):
        words = (root / name).read_text("utf-8").replace("optical", "optica\x6d")
        text(name, words)(root, outside)

    return put


DEEP = "[" * 200_000
RECORD, STORE = "sequences/000000.json", "counts/000000/spadcam-twilight.zarr/zarr.json"
SPOILED = {
    "deep record": text(RECORD, DEEP),
    "deep manifest": text("manifest.jsonl", DEEP),
    "deep description": text("croissant.json", DEEP),
    "deep store": text(STORE, DEEP),
    "deep plan": text("dataset.yaml", DEEP),
    "binary plan": text("dataset.yaml", b"\xff\xfe\0"),
    "newer dataset": text("dataset.yaml", "megalopta: 1\nformat: 99\nplan: {}\n"),
    "binary table": text("index/sequences.parquet", b"\xff" * 100),
    "tables elsewhere": table_elsewhere,
    "names elsewhere": text("splits/train.txt", "../../x\n"),
    "record is a pipe": pipe(RECORD),
    "plan is a pipe": pipe("dataset.yaml"),
    "manifest is a pipe": pipe("manifest.jsonl"),
    "list is a pipe": pipe("splits/train.txt"),
    "table is a pipe": pipe("index/sequences.parquet"),
    "frame is a pipe": pipe("radiance/000000/frame_0001.exr"),
    "picture is a pipe": pipe("training/clean/000000/frame_0001.png"),
    "store is a pipe": pipe(STORE),
    "records elsewhere": link("sequences", "{home}"),
    "card elsewhere": link("card", "{home}"),
    "page elsewhere": link("index.html", "{home}"),
    "split elsewhere": link("splits/x", "{home}"),
    "flipped description": flipped("croissant.json"),
    "removed split": lambda root, _: shutil.rmtree(root / "splits/train/Sintel"),
    "removed folder of a split": lambda root, _: (root / "splits/sample/Sintel/training/flow/000000").unlink(),
    "removed list": lambda root, _: (root / "splits/train.txt").unlink(),
    "shortened list": text("splits/train.txt", ""),
}  # fmt: skip


@pytest.mark.parametrize(
    "verb",
    ["check", *(pytest.param(verb, marks=pytest.mark.slow) for verb in VERBS if verb != "check")],
)
@pytest.mark.parametrize("name", SPOILED)
def test_no_traceback_no_hang_and_nothing_outside(
    single_dataset, tmp_path, capsys, run, name, verb
):
    root, outside = tmp_path / "inside" / "data", tmp_path / "outside"
    copied(single_dataset, root)
    outside.mkdir()
    (outside / "canary").write_text("sings")
    original = content(single_dataset)
    SPOILED[name](root, outside)
    group, which, *more = VERBS[verb]
    words = [group, which, str(root), *more]
    words += ["--out", str(tmp_path / "inside/ranking")] if verb == "benchmark" else []
    code = run(words)
    told = capsys.readouterr()
    assert "Traceback" not in told.err + told.out
    assert len(told.err) < 3000
    if code == 0:
        assert verb != "check", "damage is not told"
    assert [path.read_text() for path in outside.iterdir()] == ["sings"]
    assert {path.name for path in tmp_path.iterdir()} == {"inside", "outside"}
    assert content(single_dataset) == original
