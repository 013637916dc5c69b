"""Jobs done here one after another, or by the workers of a Dask cluster; results as they come.

A job is a function of its number that can be pickled. What it writes must not depend on where it is
done. A worker that dies is replaced, and its job begun again by another.
"""

import os
import threading
import traceback
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from itertools import islice
from typing import TYPE_CHECKING, Any

from megalopta.engine.workers import Crew, kept_alive
from megalopta.errors import UserError, machine_problem

if TYPE_CHECKING:
    from distributed import Client, Future, LocalCluster

Job = Callable[[int], object]

_PACKAGE = "megalopta"
_DEATHS = 30
"""A job during which so many workers died is given up."""
_AHEAD = 2
"""Jobs handed out for each worker, so that none waits."""
_PATIENCE_S = 1.0

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
) -> Generator[Outcome, None, None]:
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
    with connected(workers, scheduler) as (client, crew):
        yield from _by_workers(client, crew, job, indices, threads)


def attempt(job: Job, index: int, threads: int | None = None, wanted: str | None = None) -> Outcome:
    """Do a job; what goes wrong is told, not raised.

    Where this is not the version that is wanted nothing is done: it might make something else.
    """
    if wanted not in (None, own_version()):
        return Outcome(index, _other_version("a worker", own_version(), wanted), ends_all=True)
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


def own_version() -> str:
    """Version of this program, as it is installed."""
    return version(_PACKAGE)


def _check_versions(client: "Client") -> None:
    """Refuse a cluster of which a worker has another version. Raises UserError."""
    found = client.run(version, _PACKAGE, on_error="return")  # any version has that function
    for address, there in sorted(found.items()):
        if isinstance(there, PackageNotFoundError):
            raise UserError(
                f"worker {address} has no megalopta; install {own_version()} there: "
                "its environment must be that of this program"
            )
        if there != own_version():
            raise UserError(_other_version(f"worker {address}", str(there), own_version()))


def _other_version(worker: str, there: str, wanted: str) -> str:
    return f"{worker} has megalopta {there}, this is {wanted}; install the same version there"


@contextmanager
def connected(
    workers: int | None, scheduler: str | None
) -> Iterator[tuple["Client", "Crew | None"]]:
    """A client of a cluster: of a local one with so many workers, or of one that runs already.

    Raises
    ------
    UserError
        When no cluster is to be found there, or one of its workers has another version.
    """
    from distributed import Client  # slow to load

    if scheduler is None:
        with (
            _local_scheduler() as cluster,
            Client(cluster) as client,
            kept_alive(cluster.scheduler_address, workers or 1) as crew,
        ):
            yield client, crew
        return
    try:
        client = Client(scheduler, timeout=10)
    except (OSError, ValueError, TimeoutError) as problem:
        raise UserError(
            f"--scheduler {scheduler}: no Dask scheduler answers there ({problem}); start one "
            "with: dask scheduler"
        ) from None
    with client:
        _check_versions(client)
        yield client, None


@contextmanager
def _local_scheduler() -> Iterator["LocalCluster"]:
    import dask
    from distributed import LocalCluster

    settings = {
        "distributed.scheduler.allowed-failures": _DEATHS,
        "distributed.scheduler.worker-ttl": None,  # a worker that renders is silent for long
    }
    with (
        dask.config.set(settings),
        LocalCluster(n_workers=0, dashboard_address=":0", silence_logs="CRITICAL") as cluster,
    ):
        yield cluster


def _by_workers(
    client: "Client",
    crew: Crew | None,
    job: Job,
    indices: Iterable[int],
    threads: int | None,
) -> Iterator[Outcome]:
    left = iter(indices)
    running: dict[Any, int] = {}
    while True:
        wanted = _AHEAD * max(1, sum(client.nthreads().values()), crew.count if crew else 1)
        for index in islice(left, wanted - len(running)):
            running[client.submit(attempt, job, index, threads, own_version(), pure=False)] = index
        if not running:
            return
        for future in _ended(list(running), crew):
            yield _outcome(future, running.pop(future))
            future.release()


def _ended(futures: "list[Future]", crew: Crew | None) -> "list[Future]":
    """Wait until some are done. Raises UserError where no worker will ever do them."""
    from distributed import wait

    while True:
        try:
            done = wait(futures, timeout=_PATIENCE_S, return_when="FIRST_COMPLETED").done
            return sorted(done, key=futures.index)
        except TimeoutError:
            if crew and crew.is_hopeless:
                raise UserError(
                    "--workers: worker processes end as soon as they start; see what "
                    "`python -m distributed.cli.dask_worker` says, or leave --workers out"
                ) from None


def _outcome(future: "Future", index: int) -> Outcome:
    try:
        outcome: Outcome = future.result()
    except Exception as problem:  # of the cluster, not of the job
        return Outcome(index, f"its workers died or cannot do it ({_brief(problem)})")
    return outcome


def _use_threads(threads: int) -> None:
    from megalopta.render import dr

    if dr.thread_count() != threads:
        dr.set_thread_count(threads)


def _brief(problem: Exception) -> str:
    last = traceback.extract_tb(problem.__traceback__)[-1:]
    place = f" at {last[0].filename}:{last[0].lineno}" if last else ""
    return f"{type(problem).__name__}: {' '.join(str(problem).split())[:500]}{place}"
