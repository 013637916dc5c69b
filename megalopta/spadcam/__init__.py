"""The camera SPADCAM: a link to it, recordings of it, and an emulated one."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
