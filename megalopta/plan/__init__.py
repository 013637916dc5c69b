"""What a dataset of many sequences is to hold: values, ranges, and how a sequence is drawn."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
