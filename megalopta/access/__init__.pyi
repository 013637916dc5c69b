from .lazy import LazyFrames as LazyFrames
from .opened import (
    OpenedDataset as OpenedDataset,
    open_dataset as open_dataset,
)
from .pairs import FlowPairs as FlowPairs
from .sequence import Sequence as Sequence
