"""The SPAD array as a whole: its parameters, presets, the pattern of its pixels, an exposure."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
