"""Jobs done by the workers of a Dask cluster that runs already."""

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
"""Jobs handed out for each worker, so that none waits."""


def by_cluster(scheduler: str, job: Job, indices: Iterable[int]) -> Generator[Outcome, None, None]:
    """Do a job for every index by the workers of a scheduler, and yield how each ended.

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
    """Do a job where the environment is that wanted: elsewhere it might make something else."""
    if differing := _differing(environment(), wanted):
        return Outcome(index, f"a worker {differing}", ends_all=True)
    return attempt(job, index)


@cache
def environment() -> Mapping[str, str]:
    """Return all that bytes depend on: versions, models, and what Mitsuba renders with."""
    models = "-".join(STAGES[stage].model() for stage in MADE)
    variant, llvm = choose_variant().name, llvm_in_use()[1]
    return {**versions(), "models": models, "variant": variant, "LLVM": llvm}


@contextmanager
def connected(scheduler: str) -> Iterator["Client"]:
    """Give a client of a cluster.

    Raises UserError when no cluster is to be found there, or one of its workers has another
    environment.
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
    """Refuse a cluster of which a worker has another environment. Raises UserError."""
    for address, there in sorted(client.run(environment, on_error="return").items()):
        if isinstance(there, Exception):
            raise UserError(
                f"worker {address} has no megalopta {versions()['megalopta']} ({brief(there)}); "
                "its environment must be that of this program"
            )
        if differing := _differing(there, environment()):
            raise UserError(f"worker {address} {differing}")


def _differing(there: Mapping[str, str], here: Mapping[str, str]) -> str:
    """What a worker has otherwise, and the way out; nothing where all is the same."""
    names = [name for name in here if there.get(name) != here[name]]
    if not names:
        return ""
    own, others = (
        ", ".join(f"{name} {each.get(name)}" for name in names) for each in (here, there)
    )
    return f"has {others}, this program {own}; what they make would differ: install the same there"


def _outcome(future: "Future", index: int) -> Outcome:
    try:
        outcome: Outcome = future.result()
    except Exception as problem:  # of the cluster, not of the job
        return Outcome(index, f"its workers died or cannot do it ({brief(problem)})")
    return outcome
