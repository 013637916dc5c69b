from .books import write_index as write_index
from .croissant import table_path as table_path
from .finished import (
    FinishedSequence as FinishedSequence,
    difference as difference,
)
from .layout import (
    BOOKS as BOOKS,
    Tree as Tree,
    changed_record as changed_record,
)
from .manifest import (
    is_as_written as is_as_written,
    is_in_manifest as is_in_manifest,
    read_manifest as read_manifest,
)
from .record import (
    ExposureStatistics as ExposureStatistics,
    SequenceRecord as SequenceRecord,
    SequenceStatistics as SequenceStatistics,
    read_record as read_record,
)
from .splits import (
    SAMPLE as SAMPLE,
    read_lists as read_lists,
)
from .tables import TABLES as TABLES
