"""Trials side by side: the same numbers at any number of workers, and nothing measured twice."""

from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest

from megalopta.benchmark import trial as engine
from megalopta.benchmark.trial import GratingTemplate, Sweep, Trial, run_trials
from megalopta.flow.benchmark.settings import SearchSettings

from ..small import counting

FAST = SearchSettings(flux_min=1e4, flux_max=1e7, bits=(2,), metrics=("literal",), phases=2)
TRIALS = Sweep(trial=Trial(search=FAST, methods=("BM", "NDS", "IM")), values=(3, 4, 5)).trials
TEMPLATES = {GratingTemplate(): GratingTemplate().pixels()}


def run(store, workers=1, trials=TRIALS, executor=ThreadPoolExecutor, **more):
    with executor(workers, **more) as pool:
        return run_trials(trials, TEMPLATES, store, pool)


def files(store):
    return {path.name: path.read_bytes() for path in store.iterdir()}


@pytest.mark.parametrize(
    ("workers", "executor", "more"),
    [
        (3, ThreadPoolExecutor, {}),
        # two processes that load everything; engine/test_cluster.py runs a trial in another one
        pytest.param(
            2, ProcessPoolExecutor, {"mp_context": get_context("spawn")}, marks=pytest.mark.slow
        ),
    ],
)
def test_results_do_not_depend_on_workers(tmp_path, workers, executor, more):
    alone = run(tmp_path / "alone")
    together = run(tmp_path / "together", workers, TRIALS[::-1], executor, **more)
    assert together == alone
    assert files(tmp_path / "alone") == files(tmp_path / "together")


def test_a_killed_run_goes_on_where_it_stopped(tmp_path, monkeypatch):
    complete = run(tmp_path / "whole")
    measured, real = [], engine.measure_trial
    monkeypatch.setattr(engine, "measure_trial", counting(real, measured, 3))
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "killed")
    assert len(files(tmp_path / "killed")) == 2
    measured.pop()  # the third was not done
    monkeypatch.setattr(engine, "measure_trial", counting(real, measured))
    assert run(tmp_path / "killed") == complete
    assert len(measured) == len({trial for trial, *_ in measured}) == 3


@pytest.mark.parametrize("change", ["trial", "pixels", "code"])
def test_a_result_is_not_used_for_anything_else(tmp_path, monkeypatch, change):
    calls = []
    monkeypatch.setattr(engine, "measure_trial", lambda trial, *_: calls.append(trial) or ())
    run(tmp_path / "store", trials=TRIALS[:1])
    trials = TRIALS[:1]
    if change == "trial":
        trials = [TRIALS[0].model_copy(update={"seed": 1})]
    elif change == "pixels":
        monkeypatch.setitem(TEMPLATES, GratingTemplate(), np.ones((251, 251)))
    elif change == "code":
        monkeypatch.setattr(engine, "code_digest", lambda *modules: "of other code")
    run(tmp_path / "store", trials=trials)
    assert len(calls) == 2


@pytest.mark.parametrize("content", [b"", b"\xff", b"[]", b'{"curves": [{}]}'])
def test_a_damaged_record_is_measured_again(tmp_path, content):
    complete = run(tmp_path, trials=TRIALS[:1])
    (path,) = tmp_path.iterdir()
    whole = path.read_bytes()
    path.write_bytes(content)
    assert run(tmp_path, trials=TRIALS[:1]) == complete
    assert path.read_bytes() == whole
