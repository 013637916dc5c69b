"""Datasets from somebody who means harm: nothing outside is touched, and reading changes nothing.

Each is a real dataset with one thing in it that no program of ours wrote. Every verb that takes a
dataset meets it beside a home folder with files that somebody needs.
"""

import json
import os
import shutil
from pathlib import Path

import pytest
import yaml

from ..harm import link, pipe

READING = {
    "benchmark sequence": ("--out", "{out}"),
    "check files": (),
    "check truth": (),
    "report": (),
}
WORKING = {"render": ("--out", "{root}"), "sense": (), "flow": (), "benchmark photons": ()}


@pytest.fixture
def home(tmp_path):
    folder = tmp_path / "home"
    (folder / "docs").mkdir(parents=True)
    (folder / ".bashrc").write_text("precious")
    (folder / "docs" / "thesis.tex").write_text("precious")
    return folder


def settings(change):
    """Other settings in the record and in dataset.yaml."""

    def put(root, home):
        path = root / "dataset.yaml"
        values = yaml.safe_load(path.read_text("utf-8"))
        change(values["configuration"], home)
        path.write_text(yaml.safe_dump(values), "utf-8")
        record = json.loads((root / RECORD).read_text("utf-8"))
        change(record["configuration"], home)
        (root / RECORD).write_text(json.dumps(record))

    return put


def hashed(name, size, digest="0" * 32):
    """A record that names a file for every stage."""

    def put(root, home):
        path = root / RECORD
        record = json.loads(path.read_text("utf-8"))
        for stage in record["stages"].values():
            stage["files"][name.format(home=home)] = [size, digest]
        path.write_text(json.dumps(record))

    return put


RECORD = "sequences/grating.json"
HARM = {
    "link to a folder": link("results", "{home}/docs"),
    "link of the books": link(RECORD, "{home}/.bashrc"),
    "link to nothing outside": link("corrected", "{home}/new"),
    "link of the lock": link(".lock", "{home}/.bashrc"),
    "hard link of the lock": lambda root, home: os.link(home / ".bashrc", root / ".lock"),
    "pipe as the record of the sequence": pipe(RECORD),
    "endless settings": link("dataset.yaml", "/dev/zero"),
    "record by ..": hashed("../home/.bashrc", 8),
    "name by ..": settings(lambda values, _: values.update(name="../../home/docs")),
}


def state(root):
    """Names, kinds, sizes, times and targets of everything in a folder."""
    found = {}
    for path in (root, *sorted(root.rglob("*"))):
        seen = path.lstat()
        target = str(path.readlink()) if path.is_symlink() else ""
        found[str(path)] = (seen.st_mode, seen.st_size, seen.st_mtime_ns, target)
    return found


def outside(home):
    """Everything in the home folder, with its content."""
    return {
        str(path): path.read_text("utf-8") if path.is_file() else None
        for path in sorted(home.rglob("*"))
    }


def words(verb, more, root, out):
    return [*verb.split(), str(root), *(each.format(root=root, out=out) for each in more)]


@pytest.mark.parametrize("harm", HARM)
def test_a_hostile_dataset_harms_nothing(whole, tmp_path, home, capsys, run, harm):
    before, root, out, was = outside(home), tmp_path / "data", tmp_path / "out", {}
    for verb, more in {**READING, **WORKING}.items():
        if not was or state(root) != was:
            shutil.rmtree(root, ignore_errors=True)
            shutil.copytree(whole, root)
            HARM[harm](root, home)
            was = state(root)
        around = set(tmp_path.iterdir()) | {out}
        code = run(words(verb, more, root, out))
        told = capsys.readouterr().err
        assert "Traceback" not in told, verb
        assert code in ((0, 1, 2) if verb.startswith("check") else (0, 2)), verb
        if code == 2:
            assert len(told.strip().splitlines()[-1]) < 1000, verb
        assert outside(home) == before, verb
        assert set(tmp_path.iterdir()) <= around, verb
        if verb in READING and code:
            assert state(root) == was, verb


def test_a_dataset_in_a_folder_named_like_a_store_keeps_what_is_beside_it(whole, tmp_path, run):
    above = tmp_path / "archive.zarr"
    shutil.copytree(whole, above / "data")
    (above / "precious").write_text("precious")
    (above / "data/results/grating/benchmark.csv").unlink()
    assert run(["benchmark", "photons", str(above / "data")]) == 0
    assert (above / "precious").read_text() == "precious"
    assert Path(above / "data/results/grating/benchmark.csv").exists()
