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
from collections.abc import Callable, Collection, Generator, Iterable, Mapping
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, suppress
from dataclasses import dataclass
from functools import cache, partial

from megalopta.core.bounded import sentence
from megalopta.core.errors import UserError, machine_problem
from megalopta.core.freshness import BAKE_MODEL, RENDER_MODEL, SENSOR_MODEL, TRUTH_MODEL
from megalopta.core.progress import progress
from megalopta.stages.versions import versions

Job = Callable[[int], object]

_one_at_a_time = threading.Lock()


@dataclass(frozen=True)
class Outcome:
    """Outcome of a job: why it failed, and if all others would fail alike, as on a full disk."""

    index: int
    problem: str | None = None
    ends_all: bool = False


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
    outcomes = (attempt(job, index) for index in indices)
    if scheduler is not None:
        outcomes = _by_cluster(job, indices, scheduler)
    elif workers is not None:
        outcomes = _by_workers(job, indices, workers)
    with progress(title, len(indices), "sequence") as advance, closing(outcomes):
        for outcome in outcomes:
            yield outcome
            advance()


def attempt(
    job: Job, index: int, threads: int = 0, needed: Iterable[tuple[str, str]] = ()
) -> Outcome:
    """Run a job and return its outcome; errors are reported, not raised.

    It runs with a number of threads, and in the `needed` environment only: another might give other
    output.
    """
    for name, version in needed:
        if (present := environment().get(name)) != version:
            problem = f"a worker has {name} {present}, this program {name} {version}"
            return Outcome(index, f"{problem}; install the same there", ends_all=True)
    with _one_at_a_time:  # one renderer per process
        try:
            if threads:
                from megalopta.render import dr

                dr.set_thread_count(threads)
            job(index)
        except UserError as error:
            return Outcome(index, str(error))
        except Exception as error:
            refused = machine_problem(error) if isinstance(error, OSError) else None
            last = traceback.extract_tb(error.__traceback__)[-1]
            fault = (
                f"{type(error).__name__}: {sentence(str(error))} at {last.filename}:{last.lineno}"
            )
            return Outcome(index, refused or fault, ends_all=refused is not None)
    return Outcome(index)


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
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
    threading.Thread(target=_end_with_parent, daemon=True).start()
    nowhere = os.open(os.devnull, os.O_WRONLY)  # libraries may print
    for stream in (sys.stdout, sys.stderr):
        os.dup2(nowhere, stream.fileno())


def _end_with_parent() -> None:
    if parent := multiprocessing.parent_process():
        parent.join()
    os._exit(0)


def _by_cluster(job: Job, indices: Collection[int], address: str) -> Generator[Outcome, None, None]:
    from distributed import Client  # slow to load

    try:
        client = Client(address, timeout=10)
    except (OSError, ValueError, TypeError, RuntimeError) as problem:
        raise UserError(
            f"--scheduler {address}: no Dask scheduler answers there ({problem}); start one "
            "with: dask scheduler, and for tls: name certificates as docs/how-to/cluster.md says"
        ) from None
    with client:
        work = partial(attempt, job, needed=tuple(environment().items()))
        cluster = client.get_executor(pure=False)
        futures = {cluster.submit(work, index): index for index in indices}
        for future in as_completed(futures):
            if error := future.exception():  # of the cluster, not of the job
                fault = f"{type(error).__name__}: {sentence(str(error))}"
                yield Outcome(futures[future], f"its workers died or cannot run it ({fault})")
            else:
                yield future.result()


@cache
def environment() -> Mapping[str, str]:
    """Return everything that output depends on: versions, models, and Mitsuba's back end."""
    models = f"{RENDER_MODEL}.{BAKE_MODEL}.{TRUTH_MODEL}-{SENSOR_MODEL}"
    from megalopta.render import choose_variant, llvm_in_use

    variant, llvm = choose_variant().name, llvm_in_use()[1]
    return {**versions(), "models": models, "variant": variant, "LLVM": llvm}
