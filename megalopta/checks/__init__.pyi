from .integrity import run_check_files
from .panoramas import run_check_panoramas
from .physics import run_check_physics
from .truth import run_check_truth

__all__ = [
    "run_check_files",
    "run_check_panoramas",
    "run_check_physics",
    "run_check_truth",
]
