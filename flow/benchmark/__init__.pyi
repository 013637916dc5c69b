from .frame_time import milliseconds_per_frame as milliseconds_per_frame
from .result import BenchmarkResult as BenchmarkResult
from .search import photon_search as photon_search
from .sequence import (
    Clip as Clip,
    photon_benchmark as photon_benchmark,
)
from .settings import (
    BenchmarkSettings as BenchmarkSettings,
    SearchSettings as SearchSettings,
    checked_warm_up as checked_warm_up,
    default_warm_up as default_warm_up,
    each_once as each_once,
    work_units as work_units,
)
