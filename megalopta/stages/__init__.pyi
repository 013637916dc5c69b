from .correction import open_corrected as open_corrected
from .estimate import (
    BENCHED_PER_S as BENCHED_PER_S,
    LONGEST_S as LONGEST_S,
    WORTH_TELLING_S as WORTH_TELLING_S,
    size as size,
)
from .flow import responses_path as responses_path
from .ledger import Ledger as Ledger
from .noise_warning import variances as variances
from .origins import (
    provenance as provenance,
    provenance_changes as provenance_changes,
)
from .pipeline import (
    check_stage as check_stage,
    run_all as run_all,
    run_stage as run_stage,
)
from .probing import (
    Finish as Finish,
    Foreseen as Foreseen,
    Probe as Probe,
    Scale as Scale,
    foresee as foresee,
    memory_bytes as memory_bytes,
    probe as probe,
    triangles as triangles,
)
from .redo import (
    finish_move as finish_move,
    open_dataset_whole as open_dataset_whole,
)
from .registry import STAGES as STAGES
from .render import build as build
from .sense import (
    exposures as exposures,
    open_exposure as open_exposure,
)
