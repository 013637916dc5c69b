"""What turns a loaded scene into pixels: films, passes and cameras of our own."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
