"""Files of frames, bits and events, as cameras and other programs write them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
