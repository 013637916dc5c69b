"""Run jobs in this process, in processes of this machine, or on a Dask cluster.

A job is a picklable function of its number. Its output must not depend on where it runs.
"""

import ctypes
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
import traceback
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from queue import SimpleQueue

from megalopta.core.errors import UserError, machine_problem

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
                _use_threads(threads)
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


def _use_threads(threads: int) -> None:
    from megalopta.render import dr

    if dr.thread_count() != threads:
        dr.set_thread_count(threads)


def run_jobs(
    job: Job, indices: Iterable[int], workers: int | None = None, scheduler: str | None = None
) -> Generator[Outcome, None, None]:
    """Run a job for every index, in any order, and yield the outcomes.

    `workers` are processes of this machine; a dead one is replaced, and its job restarted.
    `scheduler` is the address of a Dask cluster to use instead, such as tcp://host:8786, whose
    workers see the same files. Without both, jobs run in this process. Raises UserError if
    processes cannot be started, or the cluster does not answer or has other versions.
    """
    if scheduler is not None:
        from megalopta.generation.cluster import by_cluster

        yield from by_cluster(scheduler, job, indices)
    elif workers is not None:
        yield from by_workers(job, indices, workers)
    else:
        yield from (attempt(job, index) for index in indices)


DEATHS = 30
"""Deaths of workers after which a job is given up."""
_START_FAILURES = 10
"""Failed starts of workers before it is clear that none will ever start."""
_PAUSE_S = 0.5
"""Pause before a worker that did not start is started again: memory may be short."""
_ENVIRONMENT = {
    "PYTHONSAFEPATH": "1",  # imports nothing from the working folder
    **dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"),
}
_PR_SET_PDEATHSIG = 1
_READY = Outcome(-1)


def by_workers(job: Job, indices: Iterable[int], count: int) -> Generator[Outcome, None, None]:
    """Run a job for every index in `count` processes of this machine, and yield the outcomes.

    A worker gets the job and then numbers through a pipe from the process that started it. It
    listens at no address, so nobody else can reach it. It ends when the pipe does, however the
    parent ended.

    Raises UserError if processes end as soon as they start.
    """
    crew = _Crew(job, indices, count)
    try:
        yield from crew.outcomes()
    finally:
        for worker in (*crew.idle, *crew.busy.values()):
            worker.end()


class _Worker:
    """A process, and the pipe to it."""

    def __init__(self, order: bytes, threads: int) -> None:
        self.index, self.is_ready = -1, False
        self.pipe, theirs = multiprocessing.Pipe()
        start = multiprocessing.get_context("spawn").Process
        with _environment():
            self._process = start(target=_work, args=(theirs, order, threads), daemon=True)
            self._process.start()
        theirs.close()

    def give(self, index: int) -> None:
        """Assign it a job; a failure to do so shows when its answer is read."""
        self.index = index
        with suppress(OSError):
            self.pipe.send(index)

    def end(self) -> int:
        """End it, and return its exit code; its output is complete or absent."""
        self._process.join(0.1)  # its own exit code says more than that of a kill
        self._process.kill()
        self._process.join()
        self.pipe.close()
        return self._process.exitcode or 0


class _Crew:
    """Workers, and the remaining jobs."""

    def __init__(self, job: Job, indices: Iterable[int], count: int) -> None:
        self._order, self._left, self._count = pickle.dumps(job), iter(indices), count
        self._threads = max(1, (os.cpu_count() or 1) // count)
        self._again: list[int] = []
        self._deaths: Counter[int] = Counter()
        self._failures = 0
        self.idle: list[_Worker] = []
        self.busy: dict[Connection, _Worker] = {}

    def outcomes(self) -> Generator[Outcome, None, None]:
        """Yield the outcome of each job. Raises UserError."""
        while self._give_out():
            for pipe in wait(list(self.busy)):
                assert isinstance(pipe, Connection)
                worker = self.busy.pop(pipe)
                try:
                    outcome: Outcome = pipe.recv()
                except (OSError, EOFError):
                    yield from self._died(worker)
                    continue
                if outcome == _READY:
                    worker.is_ready, self._failures = True, 0
                    self.busy[pipe] = worker
                else:
                    self.idle.append(worker)
                    yield outcome

    def _give_out(self) -> bool:
        """Assign jobs to all idle workers; return True if any works."""
        while len(self.busy) < self._count:
            index = self._again.pop() if self._again else next(self._left, None)
            if index is None:
                break
            worker = self.idle.pop() if self.idle else _Worker(self._order, self._threads)
            worker.give(index)
            self.busy[worker.pipe] = worker
        return bool(self.busy)

    def _died(self, worker: _Worker) -> Iterator[Outcome]:
        """Reassign the job of a dead worker, unless it has caused too many deaths."""
        code, index = worker.end(), worker.index
        if worker.is_ready:
            self._deaths[index] += 1
            if self._deaths[index] >= DEATHS:
                yield Outcome(index, f"{DEATHS} workers died of it")
                return
        else:
            self._failures += code > 0  # negative: it was killed
            if self._failures >= _START_FAILURES:
                raise UserError(
                    "--workers: worker processes end as soon as they start; omit --workers"
                )
            time.sleep(_PAUSE_S)
        self._again.append(index)


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


def _work(pipe: Connection, order: bytes, threads: int) -> None:
    """Run jobs until the parent process closes the pipe or ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends it
    _end_with_parent()
    nowhere = os.open(os.devnull, os.O_WRONLY)  # libraries may print
    for stream in (sys.stdout, sys.stderr):
        os.dup2(nowhere, stream.fileno())
    job = pickle.loads(order)  # loads a program, so after `_end_with_parent`
    orders: SimpleQueue[int] = SimpleQueue()
    threading.Thread(target=_listen, args=(pipe, orders), daemon=True).start()
    answer = _READY
    while True:
        pipe.send(answer)
        answer = attempt(job, orders.get(), threads)


def _end_with_parent() -> None:
    """Let Linux end this process at once with its parent.

    Elsewhere the end of the pipe ends it, once compiled code releases the GIL: compiling a kernel
    takes seconds.
    """
    parent = multiprocessing.parent_process()
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if parent and parent.pid != os.getppid():  # the parent ended while this process started
            os._exit(0)


def _listen(pipe: Connection, orders: "SimpleQueue[int]") -> None:
    with suppress(OSError, EOFError):
        while True:
            orders.put(pipe.recv())
    os._exit(0)  # even during a job: nobody waits for it
