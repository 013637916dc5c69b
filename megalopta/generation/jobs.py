"""Run jobs in this process, in processes of this machine, or on a Dask cluster.

A job is a picklable function of its number. Its output must not depend on where it runs.
"""

import threading
import traceback
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass

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
        from megalopta.generation.workers import by_workers

        yield from by_workers(job, indices, workers)
    else:
        yield from (attempt(job, index) for index in indices)
