"""Flow methods ranked on rendered sequences: error against true motion over photons."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
