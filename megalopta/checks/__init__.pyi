from .integrity import run_check_files as run_check_files
from .panoramas import run_check_panoramas as run_check_panoramas
from .physics import run_check_physics as run_check_physics
from .tree import (
    check_tree as check_tree,
    run_check_tree as run_check_tree,
)
from .truth import (
    run_check_truth as run_check_truth,
)
