"""Commands killed at random moments, and run again: the bytes of an unbroken run, and no litter."""

import shutil
import subprocess
import sys
import time

import numpy as np
import psutil
import pytest
import yaml

from megalopta.dataset.layout import Tree
from megalopta.verification.files import check_files

pytestmark = pytest.mark.slow

KILLS = 10
"""Of each command."""
PATIENCE_S = 5.0
EXPOSE = ("dataset", "expose", "--sensors", "ideal", "--light-levels", "full_moon", "0.5")


def started(*words):
    command = [sys.executable, "-m", "megalopta", *map(str, words)]
    quiet = subprocess.DEVNULL
    return subprocess.Popen(command, stdout=quiet, stderr=quiet, start_new_session=True)


def run(*words):
    start = time.monotonic()
    assert started(*words).wait() == 0
    return time.monotonic() - start


def killed(after_s, *words):
    """Kill a command, not the processes that it started; these must end by themselves."""
    process = started(*words)
    time.sleep(after_s)
    children = psutil.Process(process.pid).children(recursive=True)
    process.kill()
    process.wait()
    _, alive = psutil.wait_procs(children, PATIENCE_S)
    for each in alive:
        each.kill()
    assert not alive


def content(root):
    return {
        str(path.relative_to(root)): path.read_bytes() for path in root.rglob("*") if path.is_file()
    }


def broken_off_and_gone_on_with(words_of, begun, folder, kills=KILLS):
    """Kill a command on copies of what was begun, and compare with an unbroken run."""
    copied(begun, folder / "whole")
    lasts_s = run(*words_of(folder / "whole"))
    whole = content(folder / "whole")
    for moment in np.random.default_rng(0).uniform(0, lasts_s, kills):
        root = copied(begun, folder / f"after {moment:.3f} s")
        killed(moment, *words_of(root))
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
    group, verb, *settings = EXPOSE
    broken_off_and_gone_on_with(
        lambda root: (group, verb, root, *settings), tmp_path / "made", tmp_path
    )
