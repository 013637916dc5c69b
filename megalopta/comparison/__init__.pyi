from .cycle import (
    Aligned as Aligned,
    Cycle as Cycle,
    align as align,
    dataset_cycle as dataset_cycle,
    rendered_dataset as rendered_dataset,
)
from .levels import (
    captured_frames as captured_frames,
    simulated_frames as simulated_frames,
)
from .motion import (
    SpeedResponse as SpeedResponse,
    plate_responses as plate_responses,
)
from .moving import (
    SceneComparison as SceneComparison,
    compare_scene as compare_scene,
)
from .page import (
    write_comparison_report as write_comparison_report,
    write_motion_report as write_motion_report,
    write_scene_report as write_scene_report,
)
from .run import compare_captured as compare_captured
