"""Commands killed, or ended by Ctrl-C, at random moments, and run again: the bytes of an unbroken run, and no litter.

Verbs of stages are killed with and without --redo. `MEGALOPTA_LONG=1` kills each of them at twenty
moments.
"""

import os
import shutil
import signal
import subprocess
import sys
import time
from itertools import cycle

import numpy as np
import psutil
import pytest
import yaml

from megalopta.config.model import load
from megalopta.dataset.store import Tree
from megalopta.stages.run import run_all
from megalopta.verification.files import check_files

from ..small import TINY, content, without

pytestmark = pytest.mark.slow

IS_LONG = os.environ.get("MEGALOPTA_LONG") == "1"
PATIENCE_S = 5.0
EXPOSE = ("--sensors", "ideal", "--light-levels", "full_moon", "0.5")

# Loading takes seconds, in which nothing can be harmed: the clock starts when it is done.
PROGRAM = """
import sys
import megalopta.render.scene_renderer
from megalopta.cli.main import main
print("ready", flush=True)
main(sys.argv[1:])
"""


def started(*words):
    """A command that is loaded."""
    process = subprocess.Popen(
        [sys.executable, "-P", "-c", PROGRAM, *map(str, words)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    assert process.stdout.readline() == "ready\n"
    return process


def run(*words):
    start, process = time.monotonic(), started(*words)
    _, told = process.communicate()
    assert process.returncode == 0, told
    return time.monotonic() - start


def killed(after_s, how, *words):
    """Kill a command, not the processes that it started; these must end by themselves."""
    process = started(*words)
    time.sleep(after_s)
    children = psutil.Process(process.pid).children(recursive=True)
    process.send_signal(how)
    process.communicate()
    _, alive = psutil.wait_procs(children, PATIENCE_S)
    for each in alive:
        each.kill()
    assert not alive


def broken_off_and_gone_on_with(words_of, begun, folder, kills=10):
    """Kill a command on copies of what was begun, and compare with an unbroken run."""
    whole_root = copied(begun, folder / "whole")
    lasts_s = run(*words_of(whole_root))
    whole = content(whole_root)
    moments = np.random.default_rng(0).uniform(0, lasts_s, kills)
    for moment, how in zip(moments, cycle([signal.SIGKILL, signal.SIGINT]), strict=False):
        root = copied(begun, folder / f"after {moment:.3f} s")
        killed(moment, how, *words_of(root))
        run(*words_of(root))
        assert content(root) == whole, root
        assert not check_files(Tree(root)), root
        shutil.rmtree(root)


def copied(begun, root):
    if begun:
        shutil.copytree(begun, root, symlinks=True)
    return root


@pytest.fixture(scope="module")
def plan(single_plan, tmp_path_factory):
    every = {**single_plan.every, "trajectory": {"frames": 4}}
    changed = single_plan.model_copy(update={"sequences": 3, "every": every})
    path = tmp_path_factory.mktemp("plan") / "plan.yaml"
    path.write_text(yaml.safe_dump(changed.model_dump(mode="json")))
    return path


@pytest.mark.parametrize("workers", [(), ("--workers", "2")], ids=["alone", "workers"])
def test_make_killed_at_random_moments(plan, tmp_path, workers):
    broken_off_and_gone_on_with(
        lambda root: ("dataset", "make", plan, "--out", root, *workers), None, tmp_path
    )


def test_expose_killed_at_random_moments(plan, tmp_path):
    run("dataset", "make", plan, "--out", tmp_path / "made")
    broken_off_and_gone_on_with(lambda root: ("sense", root, *EXPOSE), tmp_path / "made", tmp_path)


def test_pictures_killed_at_random_moments(tmp_path):
    codes = np.random.default_rng(0).integers(0, 255, (40, 96, 128, 3), np.uint8)
    np.save(tmp_path / "clip.npy", codes)
    how = ("--unit", "srgb", "--photons", "2", "--products", "counts", "tiff")
    broken_off_and_gone_on_with(
        lambda root: ("sense", tmp_path / "clip.npy", *how, "--out", root), None, tmp_path
    )


FEW = {
    "trajectory.frames": "12",
    "sensors": "[spadcam]",
    "light_levels": "[starlight]",
    "methods": "[BM, IM]",
}
CHANGES = {
    "render": ("--seed", "5"),
    "sense": (
        *("--light-levels", "0.2", "starlight", "--sub-frames", "2", "--free-running"),
        *("--sensors", "[{preset: spadcam, exposure_s: 0.1}]"),
    ),
    "flow": ("--methods", "BM", "NDS"),
    "benchmark photons": ("--benchmark.repeats", "3"),
}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    root = tmp_path_factory.mktemp("kills") / "data"
    return run_all(root, load("grating", {**TINY, **FEW}))


@pytest.mark.parametrize(
    ("verb", "redo"),
    [(verb, redo) for verb in CHANGES for redo in (False, True)]
    if IS_LONG
    else [("render", False), ("flow", True), ("sense", True)],
)
def test_a_stage_killed_at_random_moments(finished, tmp_path, verb, redo):
    begun, start = copied(finished.root, tmp_path / "begun"), tmp_path / "start.yaml"
    start.write_text(
        yaml.safe_dump(finished.configuration.model_dump(mode="json"))
    )  # a dataset's folder is one, too
    if not redo:
        without(begun, verb.split()[0])

    def words_of(root):
        place = (start, "--out", root) if verb == "render" else (root,)
        return (*verb.split(), *place, *((*CHANGES[verb], "--redo") if redo else ()))

    broken_off_and_gone_on_with(words_of, begun, tmp_path, 20 if IS_LONG else 1)
