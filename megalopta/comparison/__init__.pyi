from .cycle import Aligned, Cycle, align, dataset_cycle, plate_cycle, rendered_dataset
from .levels import captured_frames, simulated_frames
from .motion import SpeedResponse, plate_responses
from .moving import SceneComparison, compare_scene
from .page import write_comparison_report, write_motion_report, write_scene_report
from .run import compare_captured

__all__ = [
    "Aligned",
    "Cycle",
    "SceneComparison",
    "SpeedResponse",
    "align",
    "captured_frames",
    "compare_captured",
    "compare_scene",
    "dataset_cycle",
    "plate_cycle",
    "plate_responses",
    "rendered_dataset",
    "simulated_frames",
    "write_comparison_report",
    "write_motion_report",
    "write_scene_report",
]
