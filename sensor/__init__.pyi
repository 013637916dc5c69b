from .change import changed, merged
from .counters.analog import AnalogCounter
from .counters.digital import DigitalCounter
from .ctia.array import (
    CtiaExposure,
    expose_ctia,
    expose_photocurrent,
    photocurrent,
    reading_current,
    reading_electrons,
    volt_moments,
)
from .ctia.bias import DacBias, FixedBias, FloatingGateBias
from .ctia.model import CtiaSensor
from .ctia.noise import CtiaNoise
from .ctia.photodiode import Photodiode
from .ctia.presets import CTIA_PRESETS, PHOTODIODES, ctia_preset
from .effects.afterpulsing import Afterpulsing
from .effects.base import Effect
from .effects.bias import Bias
from .effects.crosstalk import Crosstalk
from .effects.dark_counts import DarkCounts
from .effects.dead_time import DeadTime
from .effects.gating import Gate
from .effects.jitter import Jitter
from .effects.temperature import Temperature
from .input_files import file_content
from .optics.efficiency import Efficiency
from .optics.lens import Lens
from .optics.pixels import photon_rate
from .quantities import Expectation, Exposure
from .readout.binary import expose_binary
from .readout.events import Events, expose_events
from .readout.images import (
    IMAGE_SENSORS,
    ImageSensor,
    check_sensor,
    detected_photons,
    expectation,
    expose_image,
)
from .readout.opened import OpenedCounts, StoredFrames, open_counts, read_counts
from .readout.store import StoredCounts, write_counts
from .readout.sub_frames import sub_frames
from .sampling.streams import generator
from .spad.exposure import expose, expose_adc, expose_rate
from .spad.measured import MapFile, MeasuredMaps
from .spad.model import Sensor
from .spad.moments import event_moments, reading_moments
from .spad.order import ORDER_OF_EFFECTS, without
from .spad.presets import PRESETS, load_sensor, preset
from .spad.rates import detection_rate

__all__ = [
    "CTIA_PRESETS",
    "IMAGE_SENSORS",
    "ORDER_OF_EFFECTS",
    "PHOTODIODES",
    "PRESETS",
    "Afterpulsing",
    "AnalogCounter",
    "Bias",
    "Crosstalk",
    "CtiaExposure",
    "CtiaNoise",
    "CtiaSensor",
    "DacBias",
    "DarkCounts",
    "DeadTime",
    "DigitalCounter",
    "Effect",
    "Efficiency",
    "Events",
    "Expectation",
    "Exposure",
    "FixedBias",
    "FloatingGateBias",
    "Gate",
    "ImageSensor",
    "Jitter",
    "Lens",
    "MapFile",
    "MeasuredMaps",
    "OpenedCounts",
    "Photodiode",
    "Sensor",
    "StoredCounts",
    "StoredFrames",
    "Temperature",
    "changed",
    "check_sensor",
    "ctia_preset",
    "detected_photons",
    "detection_rate",
    "event_moments",
    "expectation",
    "expose",
    "expose_adc",
    "expose_binary",
    "expose_ctia",
    "expose_events",
    "expose_image",
    "expose_photocurrent",
    "expose_rate",
    "file_content",
    "generator",
    "load_sensor",
    "merged",
    "open_counts",
    "photocurrent",
    "photon_rate",
    "preset",
    "read_counts",
    "reading_current",
    "reading_electrons",
    "reading_moments",
    "sub_frames",
    "volt_moments",
    "without",
    "write_counts",
]
