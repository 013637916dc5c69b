"""Workers of a Dask cluster killed at random moments: the dataset is that of an undisturbed run.

The larger test is the whole claim: 20 sequences of 20 frames, ten kills. That a job whose worker dies
is done by another is tested in `tests/megalopta/engine`, cheaply.
"""

import hashlib
import os
import signal
import threading

import numpy as np
import psutil
import pytest

from megalopta.checks import check_tree
from megalopta.making import make


def content(root):
    """Hash of every file, and where links lead to."""
    return {
        str(path.relative_to(root)): str(path.readlink())
        if path.is_symlink()
        else hashlib.sha256(path.read_bytes()).hexdigest()
        for path in root.rglob("*")
        if path.is_symlink() or path.is_file()
    }


class Killer(threading.Thread):
    """Kills one worker after another, each at a random moment."""

    def __init__(self, kills, mean_pause_s):
        super().__init__(daemon=True)
        self.kills, self.killed, self.over = kills, 0, threading.Event()
        self._pauses = np.random.default_rng(0).exponential(mean_pause_s, kills)
        self._rng = np.random.default_rng(1)

    def run(self):
        for pause_s in self._pauses:
            if self.over.wait(pause_s):
                return
            children = psutil.Process().children(recursive=True)
            workers = [each for each in children if "dask_worker" in " ".join(each.cmdline())]
            if workers:
                os.kill(workers[self._rng.integers(len(workers))].pid, signal.SIGKILL)
                self.killed += 1


def made_twice(plan, folder, kills, mean_pause_s):
    undisturbed = make(folder / "serial", plan)
    killer = Killer(kills, mean_pause_s)
    killer.start()
    disturbed = make(folder / "killed", plan, workers=2)
    killer.over.set()
    killer.join()
    assert content(disturbed.root) == content(undisturbed.root)
    assert not check_tree(disturbed)
    return killer.killed


@pytest.mark.slow
def test_workers_make_what_one_process_makes_though_one_is_killed(small_plan, tmp_path):
    made_twice(small_plan, tmp_path, kills=1, mean_pause_s=2)


@pytest.mark.slow
def test_twenty_sequences_are_the_same_after_ten_kills(full_plan, tmp_path):
    assert made_twice(full_plan, tmp_path, kills=10, mean_pause_s=3) == 10
