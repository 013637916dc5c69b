from .array import (
    electron_moments,
    expose_ctia,
    expose_photocurrent,
    photocurrent,
    reading_electrons,
    volt_moments,
)
from .bias import DacBias, FixedBias, FloatingGateBias, trimmed_bias
from .calibration import Measurement, calibrate, leak_floor
from .integration import Pixel, discharge, discharge_time, estimate_current, gain_from_db
from .model import CtiaSensor, pixels
from .noise import CtiaNoise
from .photodiode import Floats, Photodiode, reverse_current
from .presets import CTIA_PRESETS, PHOTODIODES, TYPICAL_OFFSET_V, ctia_preset

__all__ = [
    "CTIA_PRESETS",
    "PHOTODIODES",
    "TYPICAL_OFFSET_V",
    "CtiaNoise",
    "CtiaSensor",
    "DacBias",
    "FixedBias",
    "FloatingGateBias",
    "Floats",
    "Measurement",
    "Photodiode",
    "Pixel",
    "calibrate",
    "ctia_preset",
    "discharge",
    "discharge_time",
    "electron_moments",
    "estimate_current",
    "expose_ctia",
    "expose_photocurrent",
    "gain_from_db",
    "leak_floor",
    "photocurrent",
    "pixels",
    "reading_electrons",
    "reverse_current",
    "trimmed_bias",
    "volt_moments",
]
