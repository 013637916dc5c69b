"""The report of a dataset: one HTML file that needs nothing else, to be opened in a browser."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
