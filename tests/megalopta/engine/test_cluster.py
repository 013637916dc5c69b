"""Jobs by processes that are replaced when they die, and by a cluster that runs already."""

import os
import signal

import pytest

from megalopta.engine import cluster, run_jobs
from megalopta.errors import UserError


class Job:
    """Writes a file; refuses number 3; dies once at number 4, so that another must do it."""

    def __init__(self, folder):
        self.folder = folder

    def __call__(self, index):
        if index == 3:
            raise UserError("three is too many")
        begun = self.folder / f"begun-{index}"
        if index == 4 and not begun.exists():
            begun.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        (self.folder / f"{index}").touch()


@pytest.fixture(scope="module")
def scheduler():
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=1,
        threads_per_worker=2,
        processes=False,
        protocol="tcp://",
        dashboard_address=":0",
    ) as cluster:
        yield cluster.scheduler_address


@pytest.mark.slow
def test_workers_that_die_are_replaced_and_their_job_is_done(tmp_path):
    outcomes = {each.index: each for each in run_jobs(Job(tmp_path), range(6), workers=1)}
    assert {index: each.problem for index, each in outcomes.items()} == {
        **dict.fromkeys(range(6)),
        3: "three is too many",
    }
    assert {path.name for path in tmp_path.iterdir()} == {"0", "1", "2", "4", "5", "begun-4"}


def test_a_cluster_that_runs_already_does_jobs(scheduler, tmp_path):
    outcomes = list(run_jobs(Job(tmp_path), range(3), scheduler=scheduler))
    assert sorted(each.index for each in outcomes) == [0, 1, 2]
    assert not any(each.problem for each in outcomes)


def test_trials_of_a_sweep_on_a_cluster_give_the_same_numbers(scheduler, tmp_path):
    from megalopta.experiments import Trial, pixels_of, run  # not what workers load for a Job

    trials = [Trial(size=20, methods=("BM",), search={"frames": 4, "repeats": 2})]
    templates = pixels_of(trial.template for trial in trials)
    here = run(trials, templates, tmp_path / "here", 1)
    there = run(trials, templates, tmp_path / "there", scheduler=scheduler)
    assert here == there


def test_a_worker_of_another_version_is_refused(scheduler, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "own_version", lambda: "9.9")
    with pytest.raises(UserError, match=r"worker tcp\S+ has megalopta 0\S+, this is 9\.9; install"):
        list(run_jobs(Job(tmp_path), range(3), scheduler=scheduler))
    assert not list(tmp_path.iterdir())


def test_a_worker_of_another_version_that_comes_later_does_nothing(tmp_path):
    outcome = cluster.attempt(Job(tmp_path), 0, wanted="9.9")
    assert outcome.ends_all
    assert "this is 9.9" in outcome.problem
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_an_address_where_nobody_answers_is_told():
    with pytest.raises(UserError, match="no Dask scheduler answers there"):
        list(run_jobs(print, [1], scheduler="tcp://127.0.0.1:9"))
