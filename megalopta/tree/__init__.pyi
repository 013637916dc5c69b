from .books import write_index as write_index
from .layout import Tree as Tree
from .record import (
    ExposureStatistics as ExposureStatistics,
    SequenceRecord as SequenceRecord,
    SequenceStatistics as SequenceStatistics,
    read_record as read_record,
)
from .splits import SAMPLE as SAMPLE
