from .integrity import run_check_files
from .panoramas import run_check_panoramas
from .physics import run_check_physics
from .reprojection import View, carried_points, rederived_flow
from .tree import check_tree, run_check_tree
from .truth import motions_of, run_check_truth

__all__ = [
    "View",
    "carried_points",
    "check_tree",
    "motions_of",
    "rederived_flow",
    "run_check_files",
    "run_check_panoramas",
    "run_check_physics",
    "run_check_tree",
    "run_check_truth",
]
