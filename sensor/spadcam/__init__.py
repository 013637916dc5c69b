"""What SPADCAM and its host say to each other: docs/spadcam-protocol.md."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
