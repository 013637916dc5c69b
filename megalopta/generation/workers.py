"""Jobs done by processes of this machine, each replaced when it dies.

A worker gets its jobs through a pipe from the process that started it, the number of which is its
argument. Nobody else can reach it, as it listens at no address; and it ends when the pipe does,
however that process ended. First comes the job, pickled, then a line for each index. The answers,
pickled, go to standard output, and nothing else does.
"""

import ctypes
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Generator, Iterable
from contextlib import suppress
from queue import SimpleQueue

from megalopta.core.errors import UserError
from megalopta.generation.jobs import Job, Outcome, attempt

# Nothing is imported from the working folder, in which anything may lie.
_COMMAND = (sys.executable, "-P", "-m", "megalopta.generation.workers")
DEATHS = 30
"""A job during which so many workers died is given up."""
_START_FAILURES = 10
"""Workers that end with an error of their own before it is clear that none will ever start."""
_PAUSE_S = 0.5
"""Before a worker that did not come up is started again: the machine may be short of memory."""
_LAST_WORDS_S = 5
"""A worker that closed its pipe has so long to end by itself."""
_PR_SET_PDEATHSIG = 1
_THREADS_ELSEWHERE = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def by_workers(job: Job, indices: Iterable[int], count: int) -> Generator[Outcome, None, None]:
    """Do a job for every index by so many processes, and yield how each ended.

    Raises UserError when processes end as soon as they start.
    """
    crew = _Crew(job, indices, count)
    try:
        yield from crew.outcomes()
    finally:
        crew.dismiss()


class _WorkerDiedError(Exception):
    """A worker ended; its job is not done."""


class _Crew:
    """So many workers, with a thread each that gives out jobs."""

    def __init__(self, job: Job, indices: Iterable[int], count: int) -> None:
        self._order = pickle.dumps((job, max(1, (os.cpu_count() or 1) // count)))
        self._left = iter(indices)
        self._ended: SimpleQueue[Outcome | None] = SimpleQueue()
        self._lock = threading.Lock()
        self._is_over = threading.Event()
        self._failures = 0
        self._workers: dict[int, subprocess.Popen[bytes]] = {}
        self._threads = [
            threading.Thread(target=self._serve, args=(place,), daemon=True)
            for place in range(count)
        ]

    def outcomes(self) -> Generator[Outcome, None, None]:
        """Yield how each job ended. Raises UserError."""
        for thread in self._threads:
            thread.start()
        working = len(self._threads)
        while working:
            if (outcome := self._ended.get()) is not None:
                yield outcome
                continue
            working -= 1
            if self._failures >= _START_FAILURES:
                raise UserError(
                    "--workers: worker processes end as soon as they start; see what "
                    f"`{' '.join(_COMMAND[1:])}` says, or leave --workers out"
                )

    def dismiss(self) -> None:
        """End all of them."""
        with self._lock:
            self._is_over.set()
            workers = list(self._workers.values())
        for worker in workers:
            _end(worker)

    def _serve(self, place: int) -> None:
        """Give one worker after another to a place, until no job is left."""
        try:
            while (index := self._next()) is not None:
                self._ended.put(self._done(place, index))
        except _WorkerDiedError:
            pass  # and no other is wanted
        finally:
            self._ended.put(None)

    def _next(self) -> int | None:
        with self._lock:
            return None if self._is_over.is_set() else next(self._left, None)

    def _done(self, place: int, index: int) -> Outcome:
        for _ in range(DEATHS):
            worker = self._workers.get(place) or self._begun(place)
            try:
                return _asked(worker, b"%d\n" % index)
            except _WorkerDiedError:
                del self._workers[place]
        return Outcome(index, f"{DEATHS} workers died of it")

    def _begun(self, place: int) -> subprocess.Popen[bytes]:
        """Start a worker and wait until it is ready.

        Raises _WorkerDiedError when no more are wanted, or none ever starts.
        """
        while self._failures < _START_FAILURES:
            worker = self._started(place)
            try:
                _asked(worker, self._order)
            except _WorkerDiedError:
                self._failures += worker.returncode > 0  # below 0 it was killed
                self._is_over.wait(_PAUSE_S)
            else:
                self._failures = 0
                return worker
        raise _WorkerDiedError

    def _started(self, place: int) -> subprocess.Popen[bytes]:
        with self._lock:
            if self._is_over.is_set():
                raise _WorkerDiedError
            pipe, environment = subprocess.PIPE, {**_THREADS_ELSEWHERE, **os.environ}
            self._workers[place] = subprocess.Popen(
                (*_COMMAND, str(os.getpid())),
                stdin=pipe,
                stdout=pipe,
                stderr=subprocess.DEVNULL,
                env=environment,
            )
            return self._workers[place]


def _asked(worker: subprocess.Popen[bytes], order: bytes) -> Outcome:
    """Return what a worker answers to an order. Raises _WorkerDiedError."""
    assert worker.stdin is not None and worker.stdout is not None
    try:
        worker.stdin.write(order)
        worker.stdin.flush()
        answer: Outcome = pickle.load(worker.stdout)
    except (OSError, EOFError, ValueError, pickle.UnpicklingError):
        with suppress(subprocess.TimeoutExpired):
            worker.wait(_LAST_WORDS_S)  # its own code tells more than that of a kill
        _end(worker)
        raise _WorkerDiedError from None
    return answer


def _end(worker: subprocess.Popen[bytes]) -> None:
    """End a worker; whatever it writes is whole or not at all."""
    worker.kill()
    worker.wait()
    for pipe in (worker.stdin, worker.stdout):
        with suppress(OSError):  # of an order that it has not read
            if pipe:
                pipe.close()


def main() -> None:
    """Do jobs until the process that gives them closes the pipe, or is no more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever started this one ends it
    _end_with_parent()
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # libraries print what they like
    job, threads = pickle.load(sys.stdin.buffer)
    orders: SimpleQueue[int] = SimpleQueue()
    threading.Thread(target=_listen, args=(orders,), daemon=True).start()
    answer = Outcome(-1)  # ready
    while True:
        pickle.dump(answer, answers)
        answers.flush()
        answer = attempt(job, orders.get(), threads)


def _end_with_parent() -> None:
    """Let Linux end this process at once with the one that started it.

    Elsewhere the end of the pipe does, once the library that computes lets go of the interpreter:
    compiling a kernel takes seconds.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if sys.argv[1:] not in ([], [str(os.getppid())]):  # which ended while this one started
            os._exit(0)


def _listen(orders: "SimpleQueue[int]") -> None:
    for line in sys.stdin.buffer:
        orders.put(int(line))
    os._exit(0)  # also in the middle of a job: nobody waits for it


if __name__ == "__main__":
    main()
