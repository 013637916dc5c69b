from .lazy import LazyFrames
from .opened import OpenedDataset, open_dataset
from .pairs import FlowPairs
from .sequence import Sequence

__all__ = [
    "FlowPairs",
    "LazyFrames",
    "OpenedDataset",
    "Sequence",
    "open_dataset",
]
