from .exposure import expose, expose_adc, expose_rate
from .fixed_pattern import draw_fixed_pattern
from .frames import over_frames
from .measured import MapFile, MeasuredMaps
from .model import Sensor
from .moments import event_moments, reading_moments, spad_expectation
from .order import ORDER_OF_EFFECTS, active_effects, without
from .presets import PRESETS, TABLE_2_1, load_sensor, preset, with_files
from .rates import checked_rate, detection_rate

__all__ = [
    "ORDER_OF_EFFECTS",
    "PRESETS",
    "TABLE_2_1",
    "MapFile",
    "MeasuredMaps",
    "Sensor",
    "active_effects",
    "checked_rate",
    "detection_rate",
    "draw_fixed_pattern",
    "event_moments",
    "expose",
    "expose_adc",
    "expose_rate",
    "load_sensor",
    "over_frames",
    "preset",
    "reading_moments",
    "spad_expectation",
    "with_files",
    "without",
]
