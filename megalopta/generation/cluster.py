"""Run jobs on the workers of a running Dask cluster."""

from collections.abc import Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from itertools import islice
from typing import TYPE_CHECKING, Any

from megalopta.core.errors import UserError
from megalopta.dataset.record import MADE
from megalopta.generation.jobs import Job, Outcome, attempt, brief
from megalopta.generation.versions import versions
from megalopta.render import choose_variant, llvm_in_use
from megalopta.stages.registry import STAGES

if TYPE_CHECKING:
    from distributed import Client, Future

_CERTIFICATES = (
    "name the certificates by DASK_DISTRIBUTED__COMM__TLS__CA_FILE, …__CLIENT__CERT and "
    "…__CLIENT__KEY in the environment"
)
_AHEAD = 2
"""Queued jobs per worker, so that none waits."""


def by_cluster(scheduler: str, job: Job, indices: Iterable[int]) -> Generator[Outcome, None, None]:
    """Run a job for every index on a scheduler's workers, and yield the outcomes.

    Raises UserError, as `connected`.
    """
    from distributed import wait  # slow to load

    with connected(scheduler) as client:
        left = iter(indices)
        running: dict[Any, int] = {}
        while True:
            wanted = _AHEAD * max(1, sum(client.nthreads().values()))
            for index in islice(left, wanted - len(running)):
                future = client.submit(attempt_alike, job, index, environment(), pure=False)
                running[future] = index
            if not running:
                return
            for future in sorted(
                wait(list(running), None, "FIRST_COMPLETED").done, key=running.__getitem__
            ):
                yield _outcome(future, running.pop(future))
                future.release()


def attempt_alike(job: Job, index: int, wanted: Mapping[str, str]) -> Outcome:
    """Run a job if the environment is the wanted one: another might give other output."""
    if differing := _differing(environment(), wanted):
        return Outcome(index, f"a worker {differing}", ends_all=True)
    return attempt(job, index)


@cache
def environment() -> Mapping[str, str]:
    """Return everything that output depends on: versions, models, and Mitsuba's back end."""
    models = "-".join(STAGES[stage].model() for stage in MADE)
    variant, llvm = choose_variant().name, llvm_in_use()[1]
    return {**versions(), "models": models, "variant": variant, "LLVM": llvm}


@contextmanager
def connected(scheduler: str) -> Iterator["Client"]:
    """Yield a client of a cluster.

    Raises UserError if there is no cluster at the address, or a worker has another environment.
    """
    from distributed import Client  # slow to load

    try:
        client = Client(scheduler, timeout=10)
    except (OSError, ValueError, TypeError, RuntimeError) as problem:
        remedy = _CERTIFICATES if scheduler.startswith("tls:") else "start one with: dask scheduler"
        raise UserError(
            f"--scheduler {scheduler}: no Dask scheduler answers there ({problem}); {remedy}"
        ) from None
    with client:
        _check_workers(client)
        yield client


def _check_workers(client: "Client") -> None:
    """Refuse a cluster with a worker of another environment. Raises UserError."""
    for address, there in sorted(client.run(environment, on_error="return").items()):
        if isinstance(there, Exception):
            raise UserError(
                f"worker {address} has no megalopta {versions()['megalopta']} ({brief(there)}); "
                "install the environment of this program there"
            )
        if differing := _differing(there, environment()):
            raise UserError(f"worker {address} {differing}")


def _differing(there: Mapping[str, str], here: Mapping[str, str]) -> str:
    """Return how a worker's environment differs, with the remedy; empty if it does not."""
    names = [name for name in here if there.get(name) != here[name]]
    if not names:
        return ""
    own, others = (
        ", ".join(f"{name} {each.get(name)}" for name in names) for each in (here, there)
    )
    return f"has {others}, this program {own}, so output would differ; install the same there"


def _outcome(future: "Future", index: int) -> Outcome:
    try:
        outcome: Outcome = future.result()
    except Exception as problem:  # a problem of the cluster, not of the job
        return Outcome(index, f"its workers died or cannot run it ({brief(problem)})")
    return outcome
