"""Run jobs in this process, in processes of this machine, or on a Dask cluster.

A job is a picklable function of its number. Its output must not depend on where it runs.
"""

import ctypes
import multiprocessing
import os
import signal
import sys
import threading
import time
import traceback
from collections import Counter, deque
from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from functools import partial

from megalopta.core.errors import UserError, machine_problem
from megalopta.core.progress import STATUS_S, current_step, elsewhere, progress

Job = Callable[[int], object]

_one_at_a_time = threading.Lock()


@dataclass(frozen=True)
class Outcome:
    """Outcome of a job."""

    index: int
    problem: str | None = None
    """Reason of failure"""
    ends_all: bool = False
    """True if all others would fail alike, such as on a full disk"""


def attempt(job: Job, index: int, threads: int | None = None) -> Outcome:
    """Run a job and return its outcome; errors are reported, not raised."""
    with _one_at_a_time:  # one renderer per process
        try:
            if threads:
                use_threads(threads)
            job(index)
        except UserError as problem:
            return Outcome(index, str(problem))
        except OSError as problem:
            refused = machine_problem(problem)
            return Outcome(index, refused or brief(problem), ends_all=refused is not None)
        except Exception as problem:
            return Outcome(index, brief(problem))
    return Outcome(index)


def brief(problem: Exception) -> str:
    """Return an error and its place, in one line."""
    last = traceback.extract_tb(problem.__traceback__)[-1:]
    place = f" at {last[0].filename}:{last[0].lineno}" if last else ""
    return f"{type(problem).__name__}: {' '.join(str(problem).split())[:500]}{place}"


def threads_of(workers: int) -> int:
    """Return the number of threads of each of some workers on this machine."""
    return max(1, (os.cpu_count() or 1) // workers)


def use_threads(threads: int) -> None:
    """Set the renderer's number of threads."""
    from megalopta.render import dr

    if dr.thread_count() != threads:
        dr.set_thread_count(threads)


def run_jobs(
    title: str,
    job: Job,
    indices: Collection[int],
    workers: int | None = None,
    scheduler: str | None = None,
) -> Generator[Outcome, None, None]:
    """Run a job for every index of a sequence, in any order; yield the outcomes, show progress.

    `workers` are processes of this machine; a dead one is replaced, and its job restarted.
    `scheduler` is the address of a Dask cluster to use instead, such as tcp://host:8786, whose
    workers see the same files. Without both, jobs run in this process. Raises UserError if
    processes cannot be started, or the cluster does not answer or has other versions.
    """
    with (
        progress(title, len(indices), "sequence") as advance,
        closing(_outcomes(job, indices, workers, scheduler)) as outcomes,
    ):
        for outcome in outcomes:
            yield outcome
            advance()


def _outcomes(
    job: Job, indices: Iterable[int], workers: int | None, scheduler: str | None
) -> Generator[Outcome, None, None]:
    if scheduler is not None:
        from megalopta.generation.cluster import by_cluster

        yield from by_cluster(scheduler, job, indices)
    elif workers is not None:
        yield from by_workers(job, indices, workers)
    else:
        yield from (attempt(job, index) for index in indices)


DEATHS = 30
"""Deaths of workers after which a job is given up."""
_VAIN_DEATHS = 10
"""Deaths without a finished job before it is clear that none will ever be finished."""
_PAUSE_S = 0.5
"""Pause after a death before another worker starts: memory may be short."""
_ENVIRONMENT = {
    "PYTHONSAFEPATH": "1",  # imports nothing from the working folder
    **dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"),
}
_PR_SET_PDEATHSIG = 1
_STEP_BYTES = 200


def by_workers(job: Job, indices: Iterable[int], count: int) -> Generator[Outcome, None, None]:
    """Run a job for every index in `count` processes of this machine, and yield the outcomes.

    Each process is an executor of its own, so that its death concerns one job, which is repeated
    after the others. A process listens at no address, and ends with its parent. Raises UserError
    if processes die before any job is finished.
    """
    left, deaths, is_vain = deque(indices), Counter[int](), True
    threads = threads_of(count)
    idle: list[_Worker] = []
    busy: dict[Future[Outcome], tuple[int, _Worker]] = {}
    with ExitStack() as workers, elsewhere(partial(_steps, busy)):
        while left or busy:
            while left and len(busy) < count:
                worker = idle.pop() if idle else workers.enter_context(closing(_Worker()))
                index = left.popleft()
                busy[worker.submit(job, index, threads)] = index, worker
            for future in wait(busy, return_when=FIRST_COMPLETED).done:
                index, worker = busy.pop(future)
                if not isinstance(future.exception(), BrokenProcessPool):
                    idle.append(worker)
                    is_vain = False
                    yield future.result()
                elif (outcome := _died(index, deaths, is_vain)) is not None:
                    yield outcome
                else:
                    left.append(index)


def _steps(busy: "Mapping[Future[Outcome], tuple[int, _Worker]]") -> str:
    """Current step of every busy worker."""
    return "; ".join(f"sequence {index}: {each.step}" for index, each in list(busy.values()))


def _died(index: int, deaths: Counter[int], is_vain: bool) -> Outcome | None:
    """Count the death of a worker; return the outcome of a job that has caused too many."""
    deaths[index] += 1
    if deaths[index] >= DEATHS:
        return Outcome(index, f"{DEATHS} workers died of it")
    if is_vain and deaths.total() >= _VAIN_DEATHS:
        raise UserError("--workers: worker processes die before a job is done; omit --workers")
    time.sleep(_PAUSE_S)
    return None


class _Worker:
    """A process of this machine, which starts with its first job."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        # without a lock: a process that dies while it holds one would stop its readers
        self._step = context.RawArray(ctypes.c_char, _STEP_BYTES)
        self._executor = ProcessPoolExecutor(
            1, mp_context=context, initializer=_begin, initargs=(self._step,)
        )

    @property
    def step(self) -> str:
        """Current step."""
        return self._step.value.decode(errors="ignore") or "at work"

    def submit(self, job: Job, index: int, threads: int) -> Future[Outcome]:
        """Begin a job."""
        with _environment():
            return self._executor.submit(attempt, job, index, threads)

    def close(self) -> None:
        """End the process at once; output is complete or absent."""
        for process in list((self._executor._processes or {}).values()):
            process.kill()
        self._executor.shutdown(cancel_futures=True)


@contextmanager
def _environment() -> Iterator[None]:
    """Set environment variables for child processes, unless they are set."""
    added = {name: value for name, value in _ENVIRONMENT.items() if name not in os.environ}
    os.environ.update(added)
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]


def _begin(step: "ctypes.Array[ctypes.c_char]") -> None:
    """Prepare a worker: it ends with its parent, by nothing else, and prints nothing.

    `step` is where it says what it does.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends it
    if sys.platform == "linux":  # at once, even while a compiler holds the GIL
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    threading.Thread(target=_report_while_needed, args=(step,), daemon=True).start()
    nowhere = os.open(os.devnull, os.O_WRONLY)  # libraries may print
    for stream in (sys.stdout, sys.stderr):
        os.dup2(nowhere, stream.fileno())


def _report_while_needed(step: "ctypes.Array[ctypes.c_char]") -> None:
    """Say the current step every second; end with the parent, even during a job."""
    parent = multiprocessing.parent_process()
    while parent and parent.is_alive():
        step.value = current_step().encode()[: _STEP_BYTES - 1]
        parent.join(STATUS_S)
    os._exit(0)
