"""Jobs by processes of this machine, which end with their parent, and by a cluster."""

import sys
from pathlib import Path

import psutil
import pytest
from distributed import LocalCluster

from megalopta.core.errors import UserError
from megalopta.stages import jobs as module
from megalopta.stages.jobs import run_jobs

from ..process_group import in_a_group, listening, members, wait_for

RUN = """
import sys
from pathlib import Path
from jobs_of_tests import Job, Slow
from megalopta.stages.jobs import run_jobs

job = {"Job": Job, "Slow": Slow}[sys.argv[1]](Path(sys.argv[2]))
print([each.index for each in run_jobs("Jobs", job, range(2), workers=2)])
"""


@pytest.fixture
def jobs(monkeypatch):
    """The module of jobs, which worker processes find, too."""
    folder = str(Path(__file__).parent)
    monkeypatch.setenv("PYTHONPATH", folder)
    monkeypatch.syspath_prepend(folder)
    import jobs_of_tests

    return jobs_of_tests


def is_worker(process):
    return "--multiprocessing-fork" in process.cmdline()


def test_workers_that_die_are_replaced_and_their_job_is_done(jobs, tmp_path):
    outcomes = {
        each.index: each for each in run_jobs("Jobs", jobs.Job(tmp_path), range(6), workers=2)
    }
    assert {index: each.problem for index, each in outcomes.items()} == {
        **dict.fromkeys(range(6)),
        3: "three is too many",
        5: "its process died twice; free memory, or lower --workers",
    }
    written = {path.name for path in tmp_path.iterdir()}
    assert written == {"0", "1", "2", "4", "begun-4"}


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


@pytest.fixture(scope="module")
def scheduler():
    with LocalCluster(
        n_workers=1,
        threads_per_worker=2,
        processes=False,
        protocol="tcp://",
        dashboard_address=":0",
    ) as cluster:
        yield cluster.scheduler_address


def test_a_cluster_that_runs_already_does_jobs(scheduler, jobs, tmp_path):
    outcomes = list(run_jobs("Jobs", jobs.Job(tmp_path), range(3), scheduler=scheduler))
    assert sorted(each.index for each in outcomes) == [0, 1, 2]
    assert not any(each.problem for each in outcomes)


def test_a_cluster_of_other_versions_does_nothing(jobs, tmp_path):
    needed = {**module.environment(), "numba": "9.9"}.items()
    outcome = module.attempt(jobs.Job(tmp_path), 0, needed=needed)
    assert outcome.ends_all
    assert outcome.problem.startswith("a worker has numba ")
    assert "this program numba 9.9; install the same" in outcome.problem
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_an_address_where_nobody_answers_is_told():
    with pytest.raises(UserError, match="no Dask scheduler answers there"):
        list(run_jobs("Jobs", print, [1], scheduler="tcp://127.0.0.1:9"))
