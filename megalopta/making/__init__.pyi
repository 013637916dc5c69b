from .cluster import Outcome, run_jobs
from .probe import dry_run
from .run import make, parse_indices

__all__ = [
    "Outcome",
    "dry_run",
    "make",
    "parse_indices",
    "run_jobs",
]
