"""Inputs of strangers under every verb: one sentence, little time and memory; nothing is run, and
nothing outside of a dataset is touched.

The slow tests run all of them, in a forked child of one process each; the fast one a sample.
"""

import json
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
import yaml

from megalopta.flow.formats import read_flow
from megalopta.sensor.formats.events import read_events
from megalopta.sensor.formats.reading import read_frames

from . import hostile_inputs as hostile, hostile_server
from .harm import as_format_2, link, pipe
from .small import agreeing

FEWEST = 500
SAMPLE = (
    "a.png-cut-0-0", "a.webp-16383²", "moving.gif-empty-0-2", "light.exr-window", "f.flo-stated", "t.ply-10^30 faces",
    "t.glb-bufferView", "t.glb-mode 99", "t.stl-cut-0-0", "t.xml-radius -1", "curve.csv-20000 rows", "a.png-is-fifo",
    "option0-nan", "size-grating-camera.width-1e12", "t.obj-nan", "tags.ptu-empty-0-2",
)  # fmt: skip
"""Cases of every kind that the fast test runs, each in a moment"""
FAMILIES = (
    hostile.whole_files,
    hostile.damaged_files,
    hostile.odd_places,
    hostile.claims,
    hostile.sizes,
    hostile.options,
)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """Folder of whole inputs, not to be changed."""
    folder = tmp_path_factory.mktemp("inputs")
    for write in (hostile.write_pictures, hostile.write_meshes, hostile.write_readings, hostile.write_texts):  # fmt: skip
        write(folder)
    return folder


@pytest.fixture(scope="module")
def run_all(inputs, tmp_path_factory):
    """Runs cases and returns what was wrong."""
    server = subprocess.Popen(
        [sys.executable, hostile_server.__file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )  # fmt: skip
    assert server.stdout.readline() == "ready\n"

    def run(cases):
        wrong = {}
        for case in cases:
            here = tmp_path_factory.mktemp("case")
            case.put(here, inputs)
            server.stdin.write(json.dumps({"words": case.words, "cwd": str(here)}) + "\n")
            server.stdin.flush()
            done = json.loads(server.stdout.readline())
            if faults := [*hostile.faults(case, done)]:
                wrong[case.name] = case.words, faults, done["told"][-500:]
            shutil.rmtree(here, ignore_errors=True)
        return wrong

    yield run
    server.communicate()  # closes its pipes, at which it ends


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
def test_an_input_is_used_or_gets_one_sentence(run_all, family):
    assert run_all(family()) == {}


@pytest.mark.slow
def test_damage_in_datasets_and_recordings_gets_one_sentence(
    run_all, inputs, whole, single_dataset
):
    assert run_all(hostile.damaged_datasets(whole, single_dataset)) == {}
    assert run_all(hostile.damaged_recordings(inputs)) == {}


def test_a_sample_of_hostile_inputs_gets_one_sentence(run_all):
    cases = [case for family in FAMILIES for case in family()]
    assert len(cases) == len({case.name for case in cases}) >= FEWEST
    sample = [case for case in cases if case.name in SAMPLE]
    assert len(sample) == len(SAMPLE)
    assert run_all(sample) == {}


@pytest.mark.parametrize(
    "name", ["f.flo", "f.flo5", "f.png", "f.pfm", "r.h5", "r.tif", "r.spc3", "r.mat"]
)
def test_readers_of_files_raise_what_they_say(inputs, tmp_path, name):
    content = (inputs / name).read_bytes()
    path = tmp_path / name
    for seed, damage in enumerate((hostile.cut, hostile.empty, hostile.noise, hostile.other_magic)):
        path.write_bytes(damage(content, np.random.default_rng(seed)))
        for read in (read_flow, read_frames, read_events):
            with pytest.raises((ValueError, OSError)):
                read(path)


# Datasets with one thing in them that no program of ours wrote, beside a home folder

RECORD = "sequences/grating.json"


def another_name(root, home):
    """Settings that name a folder outside."""
    for path in (root / "dataset.yaml", root / RECORD):
        values = yaml.safe_load(path.read_text("utf-8"))
        values["configuration"]["name"] = "../../home/docs"
        path.write_text(json.dumps(values), "utf-8")


def another_file(root, home):
    """A record that names a file outside for every stage."""
    record = json.loads((root / RECORD).read_text("utf-8"))
    for stage in record["stages"].values():
        stage["files"]["../home/.bashrc"] = [8, "0" * 32]
    (root / RECORD).write_text(json.dumps(record))


def pickled(root, home):
    """Stores whose chunks are pickles, and a record that agrees with them."""
    for store in (root / "counts/grating").glob("*.zarr"):
        as_format_2(store, home / "ran")
    agreeing(root)


HARM = {
    "link to a folder": link("results", "{home}/docs"),
    "link of the record": link(RECORD, "{home}/.bashrc"),
    "link to nothing outside": link("corrected", "{home}/new"),
    "link of the lock": link(".lock", "{home}/.bashrc"),
    "hard link of the lock": lambda root, home: os.link(home / ".bashrc", root / ".lock"),
    "pipe as the record": pipe(RECORD),
    "endless settings": link("dataset.yaml", "/dev/zero"),
    "record by ..": another_file,
    "name by ..": another_name,
    "pickles": pickled,
}
VERBS = (
    "check files data", "report data", "benchmark sequence data --out out", "render data --out data", "sense data",
    "flow data", "benchmark photons data",
)  # fmt: skip


def outside(home):
    return {path: path.is_file() and path.read_text("utf-8") for path in sorted(home.rglob("*"))}


FAST = "link of the record", "pickles"


@pytest.mark.parametrize(
    "harm", [name if name in FAST else pytest.param(name, marks=pytest.mark.slow) for name in HARM]
)
def test_a_hostile_dataset_harms_nothing(whole, tmp_path, monkeypatch, capsys, run, harm):
    monkeypatch.chdir(tmp_path)
    home, root = tmp_path / "home", tmp_path / "data"
    (home / "docs").mkdir(parents=True)
    (home / ".bashrc").write_text("precious")
    (home / "docs" / "thesis.tex").write_text("precious")
    before = outside(home)
    for verb in VERBS:
        shutil.rmtree(root, ignore_errors=True)
        shutil.copytree(whole, root)
        HARM[harm](root, home)
        code, told = run(verb.split()), capsys.readouterr().err
        assert "Traceback" not in told, verb
        assert code in ((0, 1, 2) if verb.startswith("check") else (0, 2)), verb
        assert outside(home) == before, verb
        assert {path.name for path in tmp_path.iterdir()} <= {"home", "data", "out"}, verb


def test_a_dataset_in_a_folder_named_like_a_store_keeps_what_is_beside_it(whole, tmp_path, run):
    above = tmp_path / "archive.zarr"
    shutil.copytree(whole, above / "data")
    (above / "precious").write_text("precious")
    (above / "data/results/grating/benchmark.csv").unlink()
    assert run(["benchmark", "photons", str(above / "data")]) == 0
    assert (above / "precious").read_text() == "precious"
    assert (above / "data/results/grating/benchmark.csv").exists()


@pytest.mark.slow
@pytest.mark.parametrize("allowed", [(), ("--allow-code",)])
def test_code_in_the_working_folder_is_run_only_where_that_is_asked_for(tmp_path, allowed):
    for name in ("argparse", "evil", "numba", "numpy", "pydantic", "random", "scipy", "yaml"):
        text = f"open({str(tmp_path / 'canary')!r}, 'a').write({name!r})\nflow = lambda a, b: a.x"
        (tmp_path / f"{name}.py").write_text(text)
    (tmp_path / "sweep.yaml").write_text("trial: {methods: [evil:flow], size: 20}\nvalues: [5]\n")
    words = [sys.executable, "-m", "megalopta", "benchmark", "photons", "sweep.yaml", *allowed]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    told = done.stderr.splitlines()[-1]
    if allowed:
        assert (tmp_path / "canary").read_text() == "evil"
        assert "evil.py:2; give a function of two frames" in told
    else:
        assert done.returncode == 2 and told.endswith("code that a file names by --allow-code")
        assert not (tmp_path / "canary").exists()
