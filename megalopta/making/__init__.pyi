from .exposing import (
    Exposing as Exposing,
    expose as expose,
    load_exposing as load_exposing,
)
from .probe import (
    dry_run as dry_run,
    dry_run_of_frames as dry_run_of_frames,
)
from .run import (
    make as make,
    parse_indices as parse_indices,
)
from .sequence import recorded_machinery as recorded_machinery
from .staging import (
    MADE as MADE,
    staged_sequences as staged_sequences,
)
