"""Jobs done here one after another, or by the workers of a Dask cluster; results as they come.

A job is a function of its number that can be pickled. What it writes must not depend on where it is
done. A worker that dies is replaced, and its job begun again by another.
"""

import os
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, Any

from megalopta.errors import UserError, machine_problem

if TYPE_CHECKING:
    from distributed import Client

Job = Callable[[int], object]

_DEATHS = 30
"""A job during which so many workers died is given up."""
_AHEAD = 2
"""Jobs handed out for each worker, so that none waits."""

_one_at_a_time = threading.Lock()


@dataclass(frozen=True)
class Outcome:
    """How a job ended."""

    index: int
    problem: str | None = None
    """Why it failed"""
    ends_all: bool = False
    """Whether the others would fail alike, such as on a full disk"""


def run_jobs(
    job: Job, indices: Iterable[int], workers: int | None = None, scheduler: str | None = None
) -> Iterator[Outcome]:
    """Do a job for every index, in any order, and yield how each ended.

    Parameters
    ----------
    job
    indices
    workers : int or None
        Processes of a local Dask cluster; None does all in this process.
    scheduler : str or None
        Address of a Dask cluster, such as tcp://host:8786, whose workers see the same files.
    """
    if workers is None and scheduler is None:
        yield from (attempt(job, index) for index in indices)
        return
    threads = max(1, (os.cpu_count() or 1) // workers) if workers else None
    with connected(workers, scheduler) as client:
        yield from _by_workers(client, job, indices, threads)


def attempt(job: Job, index: int, threads: int | None = None) -> Outcome:
    """Do a job; what goes wrong is told, not raised."""
    with _one_at_a_time:  # a process has one renderer
        try:
            if threads:
                _use_threads(threads)
            job(index)
        except UserError as problem:
            return Outcome(index, str(problem))
        except OSError as problem:
            told = machine_problem(problem)
            return Outcome(index, told or _brief(problem), ends_all=told is not None)
        except Exception as problem:
            return Outcome(index, _brief(problem))
    return Outcome(index)


@contextmanager
def connected(workers: int | None, scheduler: str | None) -> Iterator["Client"]:
    """A client of a cluster: of a local one with so many workers, or of one that runs already.

    Raises
    ------
    UserError
        When no cluster is to be found there.
    """
    import dask  # slow to load
    from distributed import Client, LocalCluster

    if scheduler is not None:
        try:
            client = Client(scheduler, timeout=10)
        except (OSError, ValueError, TimeoutError) as problem:
            raise UserError(
                f"--scheduler {scheduler}: no Dask scheduler answers there ({problem}); start one "
                "with: dask scheduler"
            ) from None
        with client:
            yield client
        return
    settings = {
        "distributed.scheduler.allowed-failures": _DEATHS,
        "distributed.scheduler.worker-ttl": None,  # a worker that renders is silent for long
        "distributed.comm.timeouts.connect": 60,
    }
    with (
        dask.config.set(settings),
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            memory_limit=0,
            dashboard_address=None,
            silence_logs="CRITICAL",
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client


def _by_workers(
    client: "Client", job: Job, indices: Iterable[int], threads: int | None
) -> Iterator[Outcome]:
    from distributed import as_completed

    left = iter(indices)
    running = as_completed()
    index_of: dict[Any, int] = {}

    def hand_out(count: int) -> None:
        for index in islice(left, count):
            future = client.submit(attempt, job, index, threads, pure=False)
            index_of[future.key] = index
            running.add(future)

    hand_out(_AHEAD * max(1, sum(client.nthreads().values())))
    for future in running:
        index = index_of.pop(future.key)
        try:
            outcome = future.result()
        except Exception as problem:  # of the cluster, not of the job
            outcome = Outcome(index, f"its workers died or cannot do it ({_brief(problem)})")
        future.release()
        yield outcome
        hand_out(max(1, _AHEAD * sum(client.nthreads().values()) - len(index_of)))


def _use_threads(threads: int) -> None:
    from megalopta.render import dr

    if dr.thread_count() != threads:
        dr.set_thread_count(threads)


def _brief(problem: Exception) -> str:
    last = traceback.extract_tb(problem.__traceback__)[-1:]
    place = f" at {last[0].filename}:{last[0].lineno}" if last else ""
    return f"{type(problem).__name__}: {' '.join(str(problem).split())[:500]}{place}"
