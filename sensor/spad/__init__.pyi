from .exposure import (
    Exposure,
    checked_rate,
    detection_rate,
    expected_counts,
    expose,
    expose_rate,
    over_frames,
    signal_to_noise,
)
from .fixed_pattern import draw_fixed_pattern
from .measured import MapFile, MeasuredMaps
from .model import Sensor
from .order import ORDER_OF_EFFECTS, active_effects, without
from .presets import PRESETS, TABLE_2_1, load_sensor, preset, with_files

__all__ = [
    "ORDER_OF_EFFECTS",
    "PRESETS",
    "TABLE_2_1",
    "Exposure",
    "MapFile",
    "MeasuredMaps",
    "Sensor",
    "active_effects",
    "checked_rate",
    "detection_rate",
    "draw_fixed_pattern",
    "expected_counts",
    "expose",
    "expose_rate",
    "load_sensor",
    "over_frames",
    "preset",
    "signal_to_noise",
    "with_files",
    "without",
]
