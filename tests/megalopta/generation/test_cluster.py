"""Jobs by a cluster that runs already, whose workers must be as this program is."""

import pytest
from distributed import LocalCluster

from megalopta.core.errors import UserError
from megalopta.generation import cluster
from megalopta.generation.jobs import run_jobs


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


def test_trials_of_a_sweep_on_a_cluster_give_the_same_numbers(scheduler, tmp_path):
    from megalopta.benchmark.trial import Trial, run, template_pixels

    trials = [Trial(size=20, methods=("BM",), search={"frames": 4, "repeats": 2})]
    templates = template_pixels(trial.template for trial in trials)
    here = run(trials, templates, tmp_path / "here", 1)
    there = run(trials, templates, tmp_path / "there", scheduler=scheduler)
    assert here == there


def test_a_worker_that_comes_later_and_is_otherwise_does_nothing(jobs, tmp_path):
    wanted = {**cluster.environment(), "numba": "9.9"}
    outcome = cluster.attempt_alike(jobs.Job(tmp_path), 0, wanted)
    assert outcome.ends_all
    assert outcome.problem.startswith("a worker has numba ")
    assert "this program numba 9.9, so output would differ" in outcome.problem
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_an_address_where_nobody_answers_is_told():
    with pytest.raises(UserError, match="no Dask scheduler answers there"):
        list(run_jobs("Jobs", print, [1], scheduler="tcp://127.0.0.1:9"))
