from .cluster import (
    Job as Job,
    Outcome as Outcome,
    connected as connected,
    run_jobs as run_jobs,
)
