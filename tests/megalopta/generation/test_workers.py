"""Jobs by processes of this machine: replaced when they die, unreachable, gone with their parent."""

import re
import sys

import psutil
import pytest

from megalopta.core import progress
from megalopta.core.errors import UserError
from megalopta.generation.jobs import run_jobs

from ..process_group import in_a_group, listening, members, wait_for

RUN = """
import sys
from pathlib import Path
from jobs_of_tests import Job, Slow
from megalopta.generation.jobs import run_jobs

job = {"Job": Job, "Slow": Slow}[sys.argv[1]](Path(sys.argv[2]))
print([each.index for each in run_jobs("Jobs", job, range(2), workers=2)])
"""


def is_worker(process):
    return "--multiprocessing-fork" in process.cmdline()


def test_workers_that_die_are_replaced_and_their_job_is_done(jobs, tmp_path):
    outcomes = {
        each.index: each for each in run_jobs("Jobs", jobs.Job(tmp_path), range(6), workers=2)
    }
    assert {index: each.problem for index, each in outcomes.items()} == {
        **dict.fromkeys(range(6)),
        3: "three is too many",
    }
    written = {path.name for path in tmp_path.iterdir()}
    assert written == {"0", "1", "2", "4", "5", "begun-4"}


def test_a_job_that_kills_every_worker_is_given_up(jobs, monkeypatch):
    monkeypatch.setattr("megalopta.generation.jobs.DEATHS", 2)
    (outcome,) = run_jobs("Jobs", jobs.die, [7], workers=1)
    assert outcome.problem == "2 workers died of it"


@pytest.mark.slow
def test_workers_that_never_start_are_told(jobs):
    with pytest.raises(UserError, match="die before a job is done"):
        list(run_jobs("Jobs", jobs.NeverArrives(), [7], workers=2))


def test_workers_listen_nowhere_and_end_with_a_parent_that_was_killed(jobs, tmp_path):
    with in_a_group([sys.executable, "-P", "-c", RUN, "Slow", tmp_path]) as parent:
        wait_for(lambda: len(list(tmp_path.iterdir())) == 2)
        assert len(members(parent.pid)) == 4  # one looks after the resources of the others
        assert not listening(members(parent.pid))
        parent.kill()
        wait_for(lambda: not members(parent.pid), 5)


def test_workers_end_when_no_more_outcomes_are_wanted(jobs, tmp_path):
    outcomes = run_jobs("Jobs", jobs.EndsOnce(tmp_path), range(2), workers=2)
    next(outcomes)
    outcomes.close()
    assert not [each for each in psutil.Process().children() if is_worker(each)]


def test_progress_tells_the_step_of_a_worker(jobs, monkeypatch, capsys):
    monkeypatch.setattr(progress, "INTERVAL_S", 0.1)
    list(run_jobs("Jobs", jobs.half, [7], workers=1))
    line = r"Jobs: 0 % of 1 sequences · .*; sequence 7: baking, 50 % of 2 parts · 0:0\d left"
    assert any(re.fullmatch(line, each) for each in capsys.readouterr().err.splitlines())


def test_a_worker_imports_nothing_from_the_working_folder(jobs, tmp_path):
    hostile, canary = tmp_path / "hostile", tmp_path / "canary"
    hostile.mkdir()
    for name in ("random", "psutil", "numpy", "pickle", "queue", "signal", "megalopta", "drjit"):
        (hostile / f"{name}.py").write_text(f"open({str(canary)!r}, 'a').write({name!r})")
    command = [sys.executable, "-P", "-c", RUN, "Job", tmp_path]
    with in_a_group(command, cwd=hostile, stdout=-1) as parent:
        told, errors = parent.communicate()
    assert told == "[0, 1]\n" or told == "[1, 0]\n", errors
    assert not canary.exists()
