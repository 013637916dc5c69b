from .binary import check_binary, expose_binary, unpack
from .events import Events, expose_events, histogram
from .store import Origin, counts_writer

__all__ = [
    "Events",
    "Origin",
    "check_binary",
    "counts_writer",
    "expose_binary",
    "expose_events",
    "histogram",
    "unpack",
]
