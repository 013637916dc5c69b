"""A dataset in Python: lazy arrays of light, counts, motion and truth, with their units."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
