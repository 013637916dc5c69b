"""Stages killed at random moments, and two processes at once: the tree ends as if undisturbed.

Processes of their own, whose start takes seconds, are only those that are killed and one that is met.
`MEGALOPTA_LONG=1` kills every stage at twenty moments, with and without --redo.
"""

import os
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from megalopta.cli import main
from megalopta.config.model import load
from megalopta.config.yaml_model import to_yaml
from megalopta.dataset.store import open_sequence
from megalopta.stages.ledger import Ledger
from megalopta.stages.pipeline import run_all

from ..conftest import TINY
from .test_pipeline import content

pytestmark = pytest.mark.slow

IS_LONG = os.environ.get("MEGALOPTA_LONG") == "1"
KILLS = 20 if IS_LONG else 1

# Loading takes seconds, in which nothing can be harmed: the clock starts when it is done.
PROGRAM = """
import sys
import megalopta.render.scene_renderer
from megalopta.cli.main import main
print("ready", flush=True)
main(sys.argv[1:])
"""

CHANGES = {
    "render": ("--seed", "5"),
    "sense": (
        *("--light-levels", "0.2", "starlight", "--sub-frames", "2", "--free-running"),
        *("--sensors", "[{preset: spadcam, exposure_s: 0.1}]"),
    ),
    "flow": ("--methods", "BM", "NDS"),
    "benchmark": ("--benchmark.repeats", "3"),
}
VERBS = {"benchmark": ("benchmark", "photons")}


FEW = {
    "trajectory.frames": "12",
    "sensors": "[spadcam]",
    "light_levels": "[starlight]",
    "methods": "[BM, IM]",
}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    root = tmp_path_factory.mktemp("kills") / "data"
    run_all(root, load("grating", {**TINY, **FEW}))
    return root


def start(*arguments):
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *map(str, arguments)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def wait_until_loaded(process):
    assert process.stdout.readline() == "ready\n"


def run(*arguments):
    main.main([*map(str, arguments)])


def command(stage, root, *, redo=False):
    if stage == "render":
        # a dataset's folder is a configuration, too
        first = ("render", root.parent / "start.yaml", "--out", root)
    else:
        first = (*VERBS.get(stage, (stage,)), root)
    return (*first, *CHANGES[stage], "--redo") if redo else first


@pytest.mark.parametrize(
    ("stage", "redo"),
    [(stage, redo) for stage in CHANGES for redo in (False, True)]
    if IS_LONG
    # output that is kept aside until all is made anew is every stage's
    else [("render", False), ("flow", True), ("sense", True)],
)
@pytest.mark.slow  # test_pipeline.py interrupts every stage in its own process
def test_a_killed_stage_ends_like_an_undisturbed_one(finished, tmp_path, stage, redo):
    rng = np.random.default_rng([len(stage), redo])
    configuration = open_sequence(finished).configuration
    for name in ("undisturbed", "killed"):
        root = tmp_path / name / "data"
        shutil.copytree(finished, root)
        (root.parent / "start.yaml").write_text(to_yaml(configuration))
        if not redo:
            Ledger(open_sequence(root)).forget(stage)
    undisturbed, killed = (tmp_path / name / "data" for name in ("undisturbed", "killed"))
    before = content(killed)
    began = time.perf_counter()
    run(*command(stage, undisturbed, redo=redo))
    lasts = time.perf_counter() - began
    deaths = 0
    for _ in range(KILLS):
        process = start(*command(stage, killed, redo=redo))
        wait_until_loaded(process)
        time.sleep(rng.uniform(0, lasts))
        process.send_signal(signal.SIGKILL)
        process.communicate()
        deaths += process.returncode == -signal.SIGKILL
        if redo and not (killed / ".redo/publish.json").exists():
            kept = {name: each for name, each in content(killed).items() if name[0] != "."}
            assert kept in (before, content(undisturbed))
    run(*command(stage, killed, redo=redo))
    assert content(killed) == content(undisturbed)
    print(f"{stage}, redo {redo}: killed {deaths} of {KILLS} times within {lasts:.1f} s")
