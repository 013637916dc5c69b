from .binary import expose_binary, unpack
from .events import expose_events, histogram
from .store import Origin, counts_writer

__all__ = [
    "Origin",
    "counts_writer",
    "expose_binary",
    "expose_events",
    "histogram",
    "unpack",
]
