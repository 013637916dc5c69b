from .frame_time import milliseconds_per_frame
from .result import BenchmarkResult
from .search import photon_search
from .sequence import Clip, photon_benchmark
from .settings import (
    BenchmarkSettings,
    SearchSettings,
    checked_warm_up,
    default_warm_up,
    each_once,
    work_units,
)

__all__ = [
    "BenchmarkResult",
    "BenchmarkSettings",
    "Clip",
    "SearchSettings",
    "checked_warm_up",
    "default_warm_up",
    "each_once",
    "milliseconds_per_frame",
    "photon_benchmark",
    "photon_search",
    "work_units",
]
