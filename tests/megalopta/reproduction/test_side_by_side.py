import os
import subprocess
import sys
import time
from functools import partial
from types import SimpleNamespace

import pytest

from megalopta.reproduction.drawing import side_by_side

from ..process_group import in_a_group, members, wait_for


def late(seconds, value):
    time.sleep(seconds)
    return value


def test_results_come_in_the_order_of_the_tasks():
    tasks = [partial(late, 0.2, "first"), partial(late, 0, "second"), lambda: "third"]
    assert list(side_by_side(tasks)) == ["first", "second", "third"]


def test_one_task_and_one_after_mitsuba_run_in_this_process(monkeypatch):
    assert list(side_by_side([os.getpid])) == [os.getpid()]
    running = SimpleNamespace(variant=lambda: "llvm_ad_spectral")
    monkeypatch.setitem(sys.modules, "mitsuba", running)
    assert list(side_by_side([os.getpid, os.getpid])) == [os.getpid()] * 2


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux" or (os.cpu_count() or 1) < 2, reason="nothing to fork")
def test_figures_are_the_same_bytes_from_one_process_and_from_several(tmp_path):
    # in an interpreter without Mitsuba, which other tests may have started here
    code = (
        "import os, sys; from pathlib import Path; from megalopta.reproduction.drawing import reproduce\n"
        "from megalopta.reproduction import drawing as module\n"
        "if sys.argv[2] == 'alone': module.os.cpu_count = lambda: 1\n"
        "reproduce(['fig-2.2', 'fig-3.2', 'table-2.1'], Path(sys.argv[1]))\n"
    )
    for name in ("alone", "together"):
        subprocess.run([sys.executable, "-c", code, str(tmp_path / name), name], check=True)
    paths = sorted(path.name for path in (tmp_path / "alone").glob("*.*"))
    assert len(paths) == 12
    for name in paths:
        alone, together = (tmp_path / form / name for form in ("alone", "together"))
        assert alone.read_bytes() == together.read_bytes()


@pytest.mark.skipif(sys.platform != "linux" or (os.cpu_count() or 1) < 2, reason="nothing to fork")
def test_forked_processes_end_with_a_parent_that_was_killed(tmp_path):
    code = (
        "import sys, time; from pathlib import Path\n"
        "from megalopta.reproduction.drawing import side_by_side\n"
        "def draw(): Path(sys.argv[1], str(time.monotonic_ns())).touch(); time.sleep(60)\n"
        "list(side_by_side([draw, draw]))\n"
    )
    with in_a_group([sys.executable, "-c", code, tmp_path]) as parent:
        wait_for(lambda: len(list(tmp_path.iterdir())) == 2)
        assert len(members(parent.pid)) == 3
        parent.kill()
        wait_for(lambda: not members(parent.pid), 5)
