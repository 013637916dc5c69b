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

from megalopta.dataset.store import file_hash

from ..harm import link, pipe, replaced, text

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


def sparse(name):
    """A file that claims 100 GB."""

    def put(root, _):
        (root / name).touch()
        os.truncate(root / name, 10**11)

    return put


def moving(moves, goes, links=()):
    """A move of new output that seems to have been broken off."""

    def put(root, home):
        new = root / ".redo"
        (new / RECORD).parent.mkdir(parents=True)
        for name in ("dataset.yaml", RECORD):
            shutil.copy(root / name, new / name)
        for name, target in dict(links).items():
            replaced(root / name, lambda path, to=target: path.symlink_to(to.format(home=home)))
        for name in moves:
            if not os.path.lexists(new / name) and ".." not in name and name[0] != "{":
                replaced(new / name, lambda path: path.write_text("planted"))
        names = [[name.format(home=home) for name in each] for each in (moves, goes)]
        plan = dict(zip(("moves", "goes"), names, strict=True))
        (new / "publish.json").write_text(json.dumps(plan))

    return put


def settings(change):
    """Other settings in dataset.yaml."""

    def put(root, home):
        path = root / "dataset.yaml"
        values = yaml.safe_load(path.read_text("utf-8"))
        change(values["configuration"], home)
        path.write_text(yaml.safe_dump(values), "utf-8")

    return put


def entries(root):
    """Path and content of the record, and its stages."""
    path = root / RECORD
    record = json.loads(path.read_text("utf-8"))
    return path, record, record["stages"].values()


def hashed(name, size, digest="0" * 32):
    """A record that names a file for every stage."""

    def put(root, home):
        path, record, stages = entries(root)
        for stage in stages:
            stage["files"][name.format(home=home)] = [size, digest]
        path.write_text(json.dumps(record))

    return put


def consistent(put):
    """What somebody changed, with a record that agrees."""

    def both(root, home):
        put(root, home)
        path, record, stages = entries(root)
        for stage in stages:
            for name in stage["files"]:
                found = root / name
                stage["files"][name] = [found.stat().st_size, file_hash(found)]
        path.write_text(json.dumps(record))

    return both


RECORD = "sequences/grating.json"
DEEP = "[" * 200_000
COUNTS = "counts/grating/spadcam-starlight.zarr"
RESPONSES = "results/grating/responses/spadcam-starlight.zarr"
HARM = {
    "link to a folder": link("results", "{home}/docs"),
    "link to a folder by ..": link("training/clean/grating", "../../../home/docs"),
    "link to a file": link("report.html", "{home}/.bashrc"),
    "link of the books": link(RECORD, "{home}/.bashrc"),
    "link of the settings": link("dataset.yaml", "{home}/.bashrc"),
    "link to nothing outside": link("corrected", "{home}/new"),
    "link of a frame": link("radiance/grating/frame_0001.exr", "{home}/.bashrc"),
    "link of a store": link(COUNTS, "{home}/docs"),
    "link of the lock": link(".lock", "{home}/.bashrc"),
    "link of the lock to nothing": link(".lock", "{home}/new"),
    "hard link of the lock": lambda root, home: os.link(home / ".bashrc", root / ".lock"),
    "pipe as the lock": pipe(".lock"),
    "link of what a kill left": link(".part-0123456789ab-x", "{home}/docs"),
    "link of the redo folder": link(".redo", "{home}/docs"),
    "move through a link": moving(
        [".redo/link/.bashrc", "link/.bashrc"], ["link/docs"], {"link": "../home"}
    ),
    "move of absolute names": moving(["{home}/new"], ["{home}/docs"]),
    "move by ..": moving(["../home/new"], ["../home/docs"]),
    "move of no output": moving(["training"], ["radiance"]),
    "move of a link": moving(
        ["results/grating/flow.json"], [], {".redo/results/grating/flow.json": "../../../../x"}
    ),
    "move into itself": moving(["radiance/grating"], [], {".redo/radiance": "../radiance"}),
    "move that is nested": text(".redo/publish.json", DEEP),
    "move that is endless": link(".redo/publish.json", "/dev/zero"),
    "pipe as settings": pipe("dataset.yaml"),
    "pipe as the record of the sequence": pipe(RECORD),
    "pipe as a record": pipe("radiance/grating/scene.json"),
    "pipe as a result": pipe("results/grating/flow.json"),
    "endless settings": link("dataset.yaml", "/dev/zero"),
    "endless record": link(RECORD, "/dev/zero"),
    "endless chunk": link(f"{COUNTS}/counts/c/0/0/0", "/dev/urandom"),
    "large settings": sparse("dataset.yaml"),
    "large record of the sequence": sparse(RECORD),
    "large times": sparse("timings.json"),
    "large metadata": sparse(f"{COUNTS}/zarr.json"),
    "large record": sparse("radiance/grating/scene.json"),
    "nested settings": text("dataset.yaml", DEEP[:5000]),
    "nested record of the sequence": text(RECORD, DEEP),
    "nested times": text("timings.json", DEEP),
    "nested record": consistent(text("radiance/grating/scene.json", DEEP)),
    "nested results": consistent(text("results/grating/flow.json", DEEP)),
    "nested thresholds": consistent(text("results/grating/benchmark.json", DEEP)),
    "nested metadata": consistent(text(f"{COUNTS}/zarr.json", DEEP)),
    "nested metadata of responses": consistent(text(f"{RESPONSES}/zarr.json", DEEP)),
    "settings that are a list": text("dataset.yaml", "[1, 2]"),
    "settings that are nothing": text("dataset.yaml", ""),
    "record of numbers": text(RECORD, "1\n2\n"),
    "record of a file outside": hashed("{home}/.bashrc", 8),
    "record by ..": hashed("../home/.bashrc", 8),
    "record of the folder itself": hashed(".", 1),
    "record of a folder above": hashed("results/../..", 1),
    "record of the settings": hashed("dataset.yaml", 1),
    "name that is absolute": settings(lambda values, home: values.update(name=str(home))),
    "name by ..": settings(lambda values, _: values.update(name="../../home/docs")),
    "sensor's name by ..": settings(
        lambda values, _: values["sensors"][0].update(name="../../../../home/docs/x")
    ),
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


FAST = (
    *("link to a folder", "link of the books", "link to nothing outside", "link of the lock"),
    "move through a link",
    *(
        "move of absolute names",
        "move of no output",
        "pipe as the record of the sequence",
        "endless settings",
    ),
    *("record by ..", "name by .."),
)
"""What is refused at the door, of every kind: the others let some verbs work for seconds."""


@pytest.mark.parametrize(
    "harm", [pytest.param(each, marks=[pytest.mark.slow] * (each not in FAST)) for each in HARM]
)
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
