"""Jobs done here one after another, by processes of this machine, or by a Dask cluster."""

from collections.abc import Generator, Iterable

from megalopta.generation.attempt import Job, Outcome, attempt


def run_jobs(
    job: Job, indices: Iterable[int], workers: int | None = None, scheduler: str | None = None
) -> Generator[Outcome, None, None]:
    """Do a job for every index, in any order, and yield how each ended.

    A worker that dies is replaced, and its job begun again by another.

    Parameters
    ----------
    job
    indices
    workers : int or None
        Processes of this machine; None does all in this process.
    scheduler : str or None
        Address of a Dask cluster to use instead, such as tcp://host:8786, whose workers see the
        same files.

    Raises
    ------
    UserError
        When processes cannot be started, no cluster is to be found, or it has other versions.
    """
    if scheduler is not None:
        from megalopta.generation.cluster import by_cluster

        yield from by_cluster(scheduler, job, indices)
    elif workers is not None:
        from megalopta.generation.workers import by_workers

        yield from by_workers(job, indices, workers)
    else:
        yield from (attempt(job, index) for index in indices)
