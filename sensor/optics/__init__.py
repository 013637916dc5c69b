"""From radiance to photons on a pixel, and how many of them are detected."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
