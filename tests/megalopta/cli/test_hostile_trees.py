"""Datasets of strangers under every verb that reads them: one sentence, no hang, nothing outside."""

import json
import os
import shutil

import pytest

VERBS = {
    "check": ("dataset", "check"),
    "card": ("dataset", "card"),
    "view": ("dataset", "view"),
    "expose": ("dataset", "expose", "--sensors", "ideal"),
    "benchmark": ("benchmark", "sequence"),
}


def put(path, content):
    path.unlink()
    path.write_bytes(content if isinstance(content, bytes) else content.encode())


def in_place_of(name, content):
    return lambda root: put(root / name, content)


def pipe(name):
    def spoil(root):
        (root / name).unlink()
        os.mkfifo(root / name)

    return spoil


def link(name):
    def spoil(root):
        if (root / name).is_dir():
            shutil.rmtree(root / name)
        (root / name).symlink_to(root.parents[1] / "outside")

    return spoil


def table_elsewhere(root):
    path = root / "croissant.json"
    described = json.loads(path.read_text())
    for part in described["distribution"]:
        part["contentUrl"] = "/dev/zero"
    put(path, json.dumps(described))


DEEP = "[" * 200_000
RECORD, STORE = "sequences/000000.json", "counts/000000/spadcam-twilight.zarr/zarr.json"
SPOILED = {
    "deep record": in_place_of(RECORD, DEEP),
    "deep manifest": in_place_of("manifest.jsonl", DEEP),
    "deep description": in_place_of("croissant.json", DEEP),
    "deep store": in_place_of(STORE, DEEP),
    "deep plan": in_place_of("dataset.yaml", DEEP),
    "binary plan": in_place_of("dataset.yaml", b"\xff\xfe\0"),
    "newer dataset": in_place_of("dataset.yaml", "megalopta: 1\nformat: 99\nplan: {}\n"),
    "binary table": in_place_of("index/sequences.parquet", b"\xff" * 100),
    "tables elsewhere": table_elsewhere,
    "names elsewhere": in_place_of("splits/train.txt", "../../x\n"),
    "record is a pipe": pipe(RECORD),
    "plan is a pipe": pipe("dataset.yaml"),
    "manifest is a pipe": pipe("manifest.jsonl"),
    "list is a pipe": pipe("splits/train.txt"),
    "table is a pipe": pipe("index/sequences.parquet"),
    "frame is a pipe": pipe("radiance/000000/frame_0001.exr"),
    "picture is a pipe": pipe("training/clean/000000/frame_0001.png"),
    "store is a pipe": pipe(STORE),
    "records elsewhere": link("sequences"),
    "card elsewhere": link("card"),
    "page elsewhere": link("index.html"),
    "split elsewhere": link("splits/x"),
}


def content(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    "verb",
    ["check", *(pytest.param(verb, marks=pytest.mark.slow) for verb in VERBS if verb != "check")],
)
@pytest.mark.parametrize("name", SPOILED)
def test_no_traceback_no_hang_and_nothing_outside(
    single_dataset, tmp_path, capsys, run, name, verb
):
    root, outside = tmp_path / "inside" / "data", tmp_path / "outside"
    shutil.copytree(single_dataset, root, symlinks=True, copy_function=os.link)
    outside.mkdir()
    (outside / "canary").write_text("sings")
    original = content(single_dataset)
    SPOILED[name](root)
    group, which, *more = VERBS[verb]
    words = [group, which, str(root), *more]
    words += ["--out", str(tmp_path / "inside/ranking")] if verb == "benchmark" else []
    code = run(words)
    told = capsys.readouterr()
    assert "Traceback" not in told.err + told.out
    assert len(told.err) < 3000
    if code == 0:
        assert verb != "check", "damage is not told"
    assert content(outside) == {outside / "canary": b"sings"}
    assert {path.name for path in tmp_path.iterdir()} == {"inside", "outside"}
    assert content(single_dataset) == original
