from .levels import captured_frames, simulated_frames
from .motion import SpeedResponse, plate_responses
from .page import write_comparison_report, write_motion_report
from .run import Scene, compare_captured

__all__ = [
    "Scene",
    "SpeedResponse",
    "captured_frames",
    "compare_captured",
    "plate_responses",
    "simulated_frames",
    "write_comparison_report",
    "write_motion_report",
]
