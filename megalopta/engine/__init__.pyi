from .attempt import (
    Job as Job,
    Outcome as Outcome,
)
from .cluster import connected as connected
from .jobs import run_jobs as run_jobs
