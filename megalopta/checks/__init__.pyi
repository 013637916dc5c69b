from .integrity import run_check_files as run_check_files
from .panoramas import run_check_panoramas as run_check_panoramas
from .physics import run_check_physics as run_check_physics
from .truth import run_check_truth as run_check_truth
