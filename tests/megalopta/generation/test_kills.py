"""Worker processes killed at random moments: the dataset is that of an undisturbed run.

The larger test is the whole claim: 20 sequences of 20 frames, ten kills. That a job whose worker dies
is done by another is tested in `test_workers.py`, cheaply.
"""

import contextlib
import hashlib
import threading
import time

import numpy as np
import psutil
import pytest

from megalopta.generation.making import make
from megalopta.verification.files import check_files


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
        self.kills, self.mean_pause_s = kills, mean_pause_s
        self.killed, self.over = 0, threading.Event()

    def run(self):
        rng = np.random.default_rng(0)
        while self.killed < self.kills:
            if self.over.wait(rng.exponential(self.mean_pause_s)):
                return
            if found := workers():
                with contextlib.suppress(psutil.NoSuchProcess):
                    found[rng.integers(len(found))].kill()
                    self.killed += 1


def workers():
    """Processes of workers that live."""
    found = []
    for child in psutil.Process().children(recursive=True):
        with contextlib.suppress(psutil.Error):  # it has ended meanwhile
            if "--multiprocessing-fork" in child.cmdline():
                found.append(child)
    return found


def made_twice(plan, folder, kills, monkeypatch):
    """Make a plan here, then by workers of which some are killed, each time with an empty cache."""
    start = time.monotonic()
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
    undisturbed = make(folder / "serial", plan)
    # all kills together take a third of the time, so that none comes too late
    killer = Killer(kills, (time.monotonic() - start) / (3 * kills))
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache of workers"))
    killer.start()
    disturbed = make(folder / "killed", plan, workers=2)
    killer.over.set()
    killer.join()
    assert content(disturbed.root) == content(undisturbed.root)
    assert not check_files(disturbed)
    return killer.killed


@pytest.mark.slow
def test_workers_make_what_one_process_makes_though_one_is_killed(
    small_plan, tmp_path, monkeypatch
):
    made_twice(small_plan, tmp_path, 1, monkeypatch)


@pytest.mark.slow
def test_twenty_sequences_are_the_same_after_ten_kills(full_plan, tmp_path, monkeypatch):
    assert made_twice(full_plan, tmp_path, 10, monkeypatch) == 10
