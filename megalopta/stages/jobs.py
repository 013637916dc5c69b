"""Run a job for every number: in this process, in processes of this machine, or on a Dask cluster.

A job is a picklable function of its number. Its output must not depend on where it runs.
"""

import ctypes
import multiprocessing
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Collection, Generator, Iterator, Mapping
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from functools import cache, partial
from typing import TYPE_CHECKING

from megalopta.core.errors import UserError, machine_problem
from megalopta.core.progress import progress
from megalopta.dataset.record import MADE
from megalopta.stages.registry import STAGES
from megalopta.stages.versions import versions

if TYPE_CHECKING:
    from distributed import Client

Job = Callable[[int], object]

_one_at_a_time = threading.Lock()
_PR_SET_PDEATHSIG = 1


@dataclass(frozen=True)
class Outcome:
    """Outcome of a job."""

    index: int
    problem: str | None = None
    """Reason of failure"""
    ends_all: bool = False
    """True if all others would fail alike, such as on a full disk"""


def run_jobs(
    title: str,
    job: Job,
    indices: Collection[int],
    workers: int | None = None,
    scheduler: str | None = None,
) -> Generator[Outcome, None, None]:
    """Run a job for every index, in any order; yield the outcomes, show progress.

    `workers` are processes of this machine; the job of one that dies is tried once more.
    `scheduler` is the address of a Dask cluster to use instead, such as tcp://host:8786, whose
    workers see the same files. Without both, jobs run in this process. Raises UserError if the
    cluster does not answer.
    """
    if scheduler is not None:
        outcomes = _by_cluster(job, indices, scheduler)
    elif workers is not None:
        outcomes = _by_workers(job, indices, workers)
    else:
        outcomes = (attempt(job, index) for index in indices)
    with progress(title, len(indices), "sequence") as advance, closing(outcomes):
        for outcome in outcomes:
            yield outcome
            advance()


def attempt(
    job: Job, index: int, threads: int | None = None, wanted: Mapping[str, str] | None = None
) -> Outcome:
    """Run a job and return its outcome; errors are reported, not raised.

    It runs with a number of threads, and in the `wanted` environment only: another might give other
    output.
    """
    there = environment() if wanted else {}
    if names := [name for name in wanted or {} if there.get(name) != (wanted or {})[name]]:
        has, asked = (", ".join(f"{n} {e.get(n)}" for n in names) for e in (there, wanted or {}))
        what = f"a worker has {has}, this program {asked}; install the same there"
        return Outcome(index, what, ends_all=True)
    with _one_at_a_time:  # one renderer per process
        try:
            if threads:
                from megalopta.render import dr

                dr.set_thread_count(threads)
            job(index)
        except UserError as problem:
            return Outcome(index, str(problem))
        except Exception as problem:
            refused = machine_problem(problem) if isinstance(problem, OSError) else None
            return Outcome(index, refused or _brief(problem), ends_all=refused is not None)
    return Outcome(index)


def _brief(problem: BaseException) -> str:
    """Return an error and its place, in one line."""
    last = traceback.extract_tb(problem.__traceback__)[-1:]
    place = f" at {last[0].filename}:{last[0].lineno}" if last else ""
    return f"{type(problem).__name__}: {' '.join(str(problem).split())[:500]}{place}"


def threads_of(workers: int) -> int:
    """Return the number of threads of each of some workers on this machine."""
    return max(1, (os.cpu_count() or 1) // workers)


def _by_workers(job: Job, indices: Collection[int], count: int) -> Generator[Outcome, None, None]:
    """When a process dies, the jobs that ran run once more, each alone."""
    os.environ.setdefault("PYTHONSAFEPATH", "1")  # imports nothing from the working folder
    for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    spawn = multiprocessing.get_context("spawn")  # never fork after Mitsuba
    left, suspects = list(indices), list[int]()
    while left or suspects:
        batch = [suspects.pop(0)] if (is_alone := bool(suspects)) else left
        pool = ProcessPoolExecutor(min(count, len(batch)), spawn, _begin)
        futures, done = dict[Future[Outcome], int](), set[int]()
        try:
            with suppress(BrokenProcessPool):  # at once
                for index in batch:
                    futures[pool.submit(attempt, job, index, threads_of(count))] = index
            for future in as_completed(futures):
                if not isinstance(future.exception(), BrokenProcessPool):
                    done.add(futures[future])
                    yield future.result()
        finally:
            for process in list((pool._processes or {}).values()):
                process.kill()  # output is complete or absent
            pool.shutdown(cancel_futures=True)
        broken = [index for index in batch if index not in done]
        if not is_alone:  # jobs begin in order
            suspects, left = broken[:count], broken[count:]
        elif broken:
            yield Outcome(broken[0], "its process died twice; free memory, or lower --workers")


def _begin() -> None:
    """Prepare a worker: it ends with its parent, by nothing else, and prints nothing."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends it
    if sys.platform == "linux":  # at once, even while a compiler holds the GIL
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    nowhere = os.open(os.devnull, os.O_WRONLY)  # libraries may print
    for stream in (sys.stdout, sys.stderr):
        os.dup2(nowhere, stream.fileno())


def _end_with_parent() -> None:
    if parent := multiprocessing.parent_process():
        parent.join()
    os._exit(0)


def _by_cluster(
    job: Job, indices: Collection[int], scheduler: str
) -> Generator[Outcome, None, None]:
    with connected(scheduler) as client:
        work, cluster = partial(attempt, job, wanted=environment()), client.get_executor(pure=False)
        futures = {cluster.submit(work, index): index for index in indices}
        for future in as_completed(futures):
            if problem := future.exception():  # of the cluster, not of the job
                what = f"its workers died or cannot run it ({_brief(problem)})"
                yield Outcome(futures[future], what)
            else:
                yield future.result()


@cache
def environment() -> Mapping[str, str]:
    """Return everything that output depends on: versions, models, and Mitsuba's back end."""
    models = "-".join(STAGES[stage].model() for stage in MADE)
    from megalopta.render import choose_variant, llvm_in_use

    variant, llvm = choose_variant().name, llvm_in_use()[1]
    return {**versions(), "models": models, "variant": variant, "LLVM": llvm}


@contextmanager
def connected(scheduler: str) -> Iterator["Client"]:
    """Yield a client of a cluster. Raises UserError if there is none at the address."""
    from distributed import Client  # slow to load

    try:
        client = Client(scheduler, timeout=10)
    except (OSError, ValueError, TypeError, RuntimeError) as problem:
        raise UserError(
            f"--scheduler {scheduler}: no Dask scheduler answers there ({problem}); start one "
            "with: dask scheduler, and for tls: name certificates as docs/how-to/cluster.md says"
        ) from None
    with client:
        yield client
