"""From raw readings back to detections: what every laboratory does before it looks at frames."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
