"""Hostile and damaged inputs of every format under every verb: one sentence, little time and memory.

The slow test runs all of them, in a forked child of one process each; the fast one a sample.
"""

import json
import subprocess
import sys
from itertools import chain
from pathlib import Path

import pytest

from megalopta.flow.formats import read_flow
from megalopta.sensor.formats.reading import read_events, read_frames

from . import hostile_inputs as hostile, hostile_server

FEWEST = 700
SAMPLE = (
    "a.png-cut-0-0", "a.webp-16383²-0", "moving.gif-empty-0-4", "light.exr-window-0", "f.flo-stated-1", "f.png-cut-1-0",
    "t.ply-10^30 faces-0", "t.glb-bufferView-0", "t.glb-mode 99-0", "t.stl-cut-0-0", "t.xml-radius -1-0", "t.xml-spectrum-0",
    "curve.csv-20000 rows-0", "path.csv-10^6 rows-0", "a.png-is-fifo", "config.yaml-odd_text-0-9", "option0-nan",
    "size-grating-camera.width-1e12", "size-grating-trajectory.frames-999999999", "t.obj-nan-0", "tags.ptu-empty-0-4", "t.glb-is-sparse", "t.mtl-is-sparse", "board.jsonl-is-loop",
)  # fmt: skip
"""Cases of every kind that the fast test runs, each in a moment"""


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """Folder of whole inputs, not to be changed."""
    folder = tmp_path_factory.mktemp("inputs")
    hostile.write_whole(folder)
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
            if faults := hostile.faults(case, done):
                wrong[case.name] = case.words, faults, done["told"][-500:]
            subprocess.run(["rm", "-rf", str(here)], check=True)
        return wrong

    yield run
    server.communicate()  # closes its pipes, at which it ends


FAMILIES = (
    hostile.whole_files,
    hostile.damaged_files,
    hostile.odd_places,
    hostile.claims,
    hostile.sizes,
    hostile.options,
)


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
def test_an_input_is_used_or_gets_one_sentence(run_all, family):
    assert run_all(family()) == {}


@pytest.mark.slow
def test_damage_in_datasets_and_recordings_gets_one_sentence(
    run_all, inputs, whole, single_dataset
):
    cases = chain(
        hostile.damaged_datasets(whole, single_dataset), hostile.damaged_recordings(inputs), hostile.settings(whole)
    )  # fmt: skip
    assert run_all(cases) == {}


def test_a_sample_of_hostile_inputs_gets_one_sentence(run_all):
    cases = [case for family in FAMILIES for case in family() if case.name in SAMPLE]
    assert len(cases) == len(SAMPLE)
    assert run_all(cases) == {}


def test_there_are_enough_cases():
    names = [case.name for family in FAMILIES for case in family()]
    assert len(names) == len(set(names)) >= FEWEST


@pytest.mark.parametrize(
    "name", ["f.flo", "f.flo5", "f.png", "f.pfm", "r.h5", "r.npz", "r.tif", "r.spc3"]
)
def test_readers_of_files_raise_what_they_say(inputs, tmp_path, name):
    content = (inputs / name).read_bytes()
    path = tmp_path / name
    for seed, damage in enumerate((hostile.cut, hostile.empty, hostile.noise, hostile.other_magic)):
        path.write_bytes(damage(content, hostile.np.random.default_rng(seed)))
        for read in (read_flow, read_frames, read_events):
            with pytest.raises((ValueError, OSError)):
                read(Path(path))
