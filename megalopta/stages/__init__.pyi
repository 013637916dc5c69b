from .correction import open_corrected
from .estimate import announce_sweep, size
from .flow import responses_path
from .ledger import Ledger
from .noise_warning import variances
from .pipeline import check_stage, run_all, run_stage
from .redo import open_dataset_whole
from .registry import STAGES
from .render import build
from .sense import exposures, light_scale, open_exposure

__all__ = [
    "STAGES",
    "Ledger",
    "announce_sweep",
    "build",
    "check_stage",
    "exposures",
    "light_scale",
    "open_corrected",
    "open_dataset_whole",
    "open_exposure",
    "responses_path",
    "run_all",
    "run_stage",
    "size",
    "variances",
]
