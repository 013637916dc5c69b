from .books import write_index
from .layout import Tree
from .record import ExposureStatistics, SequenceRecord, SequenceStatistics, read_record
from .splits import SAMPLE

__all__ = [
    "SAMPLE",
    "ExposureStatistics",
    "SequenceRecord",
    "SequenceStatistics",
    "Tree",
    "read_record",
    "write_index",
]
