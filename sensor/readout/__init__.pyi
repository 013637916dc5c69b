from .binary import expose_binary, unpack
from .events import expose_events, histogram

__all__ = [
    "expose_binary",
    "expose_events",
    "histogram",
    "unpack",
]
