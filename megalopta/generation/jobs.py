"""Jobs done here one after another, by processes of this machine, or by a Dask cluster.

A job is a function of its number that can be pickled. What it writes must not depend on where it is
done.
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
    """How a job ended."""

    index: int
    problem: str | None = None
    """Why it failed"""
    ends_all: bool = False
    """Whether the others would fail alike, such as on a full disk"""


def attempt(job: Job, index: int, threads: int | None = None) -> Outcome:
    """Do a job and return how it ended; what goes wrong is told, not raised."""
    with _one_at_a_time:  # a process has one renderer
        try:
            if threads:
                _use_threads(threads)
            job(index)
        except UserError as problem:
            return Outcome(index, str(problem))
        except OSError as problem:
            told = machine_problem(problem)
            return Outcome(index, told or brief(problem), ends_all=told is not None)
        except Exception as problem:
            return Outcome(index, brief(problem))
    return Outcome(index)


def brief(problem: Exception) -> str:
    """Return what went wrong and where, in one line."""
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
    """Do a job for every index, in any order, and yield how each ended.

    `workers` are processes of this machine, of which one that dies is replaced, and its job begun
    again by another; `scheduler` is the address of a Dask cluster to use instead, such as
    tcp://host:8786, whose workers see the same files; without both all is done in this process.
    Raises UserError when processes cannot be started, no cluster is to be found, or it has other
    versions.
    """
    if scheduler is not None:
        from megalopta.generation.cluster import by_cluster

        yield from by_cluster(scheduler, job, indices)
    elif workers is not None:
        from megalopta.generation.workers import by_workers

        yield from by_workers(job, indices, workers)
    else:
        yield from (attempt(job, index) for index in indices)
