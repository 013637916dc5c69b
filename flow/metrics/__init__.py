"""How good a response is: against itself, against the truth, against the physical limit."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
