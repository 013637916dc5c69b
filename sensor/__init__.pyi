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
    reading_moments,
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
from .readout.binary import expose_binary
from .readout.events import Events, expose_events
from .readout.images import (
    IMAGE_SENSORS,
    ImageSensor,
    check_sensor,
    detected_photons,
    expected_reading,
    expose_image,
    incident_photons,
    reading_signal_to_noise,
)
from .readout.store import StoredCounts, read_counts, write_counts
from .sampling.streams import generator
from .spad.exposure import (
    Exposure,
    detection_rate,
    expected_counts,
    expose,
    expose_rate,
    signal_to_noise,
)
from .spad.measured import MapFile, MeasuredMaps
from .spad.model import Sensor
from .spad.order import ORDER_OF_EFFECTS, without
from .spad.presets import PRESETS, load_sensor, preset

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
    "Exposure",
    "FixedBias",
    "FloatingGateBias",
    "Gate",
    "ImageSensor",
    "Jitter",
    "Lens",
    "MapFile",
    "MeasuredMaps",
    "Photodiode",
    "Sensor",
    "StoredCounts",
    "Temperature",
    "changed",
    "check_sensor",
    "ctia_preset",
    "detected_photons",
    "detection_rate",
    "expected_counts",
    "expected_reading",
    "expose",
    "expose_binary",
    "expose_ctia",
    "expose_events",
    "expose_image",
    "expose_photocurrent",
    "expose_rate",
    "file_content",
    "generator",
    "incident_photons",
    "load_sensor",
    "merged",
    "photocurrent",
    "photon_rate",
    "preset",
    "read_counts",
    "reading_current",
    "reading_electrons",
    "reading_moments",
    "reading_signal_to_noise",
    "signal_to_noise",
    "without",
    "write_counts",
]
