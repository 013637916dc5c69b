"""Jobs by a cluster that runs already, whose workers must be as this program is."""

import os
import subprocess
import sys

import pytest
from distributed import Client, LocalCluster

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
    outcomes = list(run_jobs(jobs.Job(tmp_path), range(3), scheduler=scheduler))
    assert sorted(each.index for each in outcomes) == [0, 1, 2]
    assert not any(each.problem for each in outcomes)


def test_trials_of_a_sweep_on_a_cluster_give_the_same_numbers(scheduler, tmp_path):
    from megalopta.benchmark.runner import run
    from megalopta.benchmark.trial import Trial, pixels_of

    trials = [Trial(size=20, methods=("BM",), search={"frames": 4, "repeats": 2})]
    templates = pixels_of(trial.template for trial in trials)
    here = run(trials, templates, tmp_path / "here", 1)
    there = run(trials, templates, tmp_path / "there", scheduler=scheduler)
    assert here == there


def test_a_worker_that_comes_later_and_is_otherwise_does_nothing(jobs, tmp_path):
    wanted = {**cluster.environment(), "numba": "9.9"}
    outcome = cluster.attempt_alike(jobs.Job(tmp_path), 0, wanted)
    assert outcome.ends_all
    assert outcome.problem.startswith("a worker has numba ")
    assert "this program numba 9.9; what they make would differ" in outcome.problem
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lacking", "told"),
    [
        ({"DRJIT_LIBLLVM_PATH": "/none"}, "has variant scalar_spectral, this program variant llvm"),
        ({"PYTHONPATH": "WITHOUT"}, "has no megalopta 0"),
    ],
)
def test_a_cluster_with_a_worker_that_lacks_something_is_refused(lacking, told, tmp_path):
    (tmp_path / "sitecustomize.py").write_text("import sys; sys.modules['megalopta'] = None")
    lacking = {name: value.replace("WITHOUT", str(tmp_path)) for name, value in lacking.items()}
    options = ["--no-nanny", "--no-dashboard", "--host", "127.0.0.1", "--nthreads", "1"]
    with LocalCluster(n_workers=0, host="127.0.0.1", dashboard_address=None) as alone:
        address = alone.scheduler_address
        with (
            Client(address) as client,
            subprocess.Popen(
                [sys.executable, "-P", "-m", "distributed.cli.dask_worker", address, *options],
                env={**os.environ, **lacking},
                stderr=subprocess.DEVNULL,
                cwd=tmp_path,
            ) as worker,
        ):
            try:
                client.wait_for_workers(1, timeout=120)
                with pytest.raises(UserError, match=rf"worker tcp://127\.0\.0\.1:\d+ {told}"):
                    list(run_jobs(print, range(3), scheduler=address))
            finally:
                worker.kill()


@pytest.mark.slow
def test_an_address_where_nobody_answers_is_told():
    with pytest.raises(UserError, match="no Dask scheduler answers there"):
        list(run_jobs(print, [1], scheduler="tcp://127.0.0.1:9"))
