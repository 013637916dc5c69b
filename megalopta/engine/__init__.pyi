from .cluster import Job, Outcome, connected, run_jobs

__all__ = [
    "Job",
    "Outcome",
    "connected",
    "run_jobs",
]
