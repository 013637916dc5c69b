"""What a SPAD adds and loses: one effect a file, with its parameters, its law and its sampler."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
