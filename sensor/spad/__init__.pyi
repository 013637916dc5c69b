from .exposure import (
    Exposure,
    checked_rate,
    detection_rate,
    expected_counts,
    expose,
    expose_rate,
    over_frames,
    photon_rate,
    signal_to_noise,
)
from .fixed_pattern import fabricate
from .measured import MapFile, MeasuredMaps
from .model import Sensor
from .order import active_effects, without
from .presets import PRESETS, TABLE_2_1, load_sensor, preset, with_files

__all__ = [
    "PRESETS",
    "TABLE_2_1",
    "Exposure",
    "MapFile",
    "MeasuredMaps",
    "Sensor",
    "active_effects",
    "checked_rate",
    "detection_rate",
    "expected_counts",
    "expose",
    "expose_rate",
    "fabricate",
    "load_sensor",
    "over_frames",
    "photon_rate",
    "preset",
    "signal_to_noise",
    "with_files",
    "without",
]
