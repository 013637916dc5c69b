from .exposing import Exposing, expose, load_exposing
from .probe import dry_run
from .run import make, parse_indices

__all__ = [
    "Exposing",
    "dry_run",
    "expose",
    "load_exposing",
    "make",
    "parse_indices",
]
