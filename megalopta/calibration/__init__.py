"""From recordings of a camera to a device file that the sensor stage loads, and a report."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
