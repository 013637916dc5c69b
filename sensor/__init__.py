"""Light to single-photon counts: every effect of a SPAD array, on plain arrays.

    sensor = preset("spadcam")
    exposure = expose(radiance, bands_nm, sensor, seed=0, sequence="forest")
    exposure.counts, exposure.expected, exposure.saturated

Light to volts, at 0.9 to 1.7 µm: an array of photodiodes with CTIA pixels.

    sensor = ctia_preset("ctia_ingaas_quiet")
    reading = expose_ctia(radiance, bands_nm, sensor, seed=0, sequence="forest")
    reading.volts, reading.expected, reading.saturated

`expose_image` takes either sensor and gives counts or electrons.

Radiance is (T, H, W, B), W·m⁻²·sr⁻¹·nm⁻¹, bands_nm is (B, 2). Neither a renderer nor its files are
needed: any video in these units will do.
"""

from megalopta.sensor.afterpulsing import Afterpulsing
from megalopta.sensor.analog_counter import AnalogCounter
from megalopta.sensor.bias import Bias
from megalopta.sensor.binary import expose_binary
from megalopta.sensor.chain import ORDER_OF_EFFECTS, Effect, without
from megalopta.sensor.change import changed
from megalopta.sensor.counter import DigitalCounter
from megalopta.sensor.counts_store import StoredCounts, read_counts, write_counts
from megalopta.sensor.crosstalk import Crosstalk
from megalopta.sensor.ctia_array import (
    CtiaExposure,
    expose_ctia,
    expose_photocurrent,
    photocurrent,
    reading_current,
    reading_electrons,
    reading_moments,
)
from megalopta.sensor.ctia_bias import DacBias, FixedBias, FloatingGateBias
from megalopta.sensor.ctia_calibration import Measurement, calibrate, leak_floor
from megalopta.sensor.ctia_integration import Pixel, discharge, estimate_current
from megalopta.sensor.ctia_noise import CtiaNoise
from megalopta.sensor.ctia_photodiode import Photodiode
from megalopta.sensor.ctia_presets import CTIA_PRESETS, PHOTODIODES, ctia_preset
from megalopta.sensor.ctia_sensor import CtiaSensor
from megalopta.sensor.dark_counts import DarkCounts
from megalopta.sensor.dead_time import DeadTime
from megalopta.sensor.efficiency import Efficiency
from megalopta.sensor.events import Events, expose_events
from megalopta.sensor.exposure import (
    Exposure,
    detection_rate,
    expected_counts,
    expose,
    expose_rate,
    photon_rate,
    signal_to_noise,
)
from megalopta.sensor.gating import Gate
from megalopta.sensor.image_sensor import (
    IMAGE_SENSORS,
    ImageSensor,
    check_sensor,
    detected_photons,
    expected_reading,
    expose_image,
    incident_photons,
    reading_signal_to_noise,
)
from megalopta.sensor.jitter import Jitter
from megalopta.sensor.measured import MapFile, MeasuredMaps
from megalopta.sensor.model import Sensor
from megalopta.sensor.optics import Lens
from megalopta.sensor.presets import PRESETS, load_sensor, preset
from megalopta.sensor.randomness import generator
from megalopta.sensor.temperature import Temperature

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
    "Measurement",
    "Photodiode",
    "Pixel",
    "Sensor",
    "StoredCounts",
    "Temperature",
    "calibrate",
    "changed",
    "check_sensor",
    "ctia_preset",
    "detected_photons",
    "detection_rate",
    "discharge",
    "estimate_current",
    "expected_counts",
    "expected_reading",
    "expose",
    "expose_binary",
    "expose_ctia",
    "expose_events",
    "expose_image",
    "expose_photocurrent",
    "expose_rate",
    "generator",
    "incident_photons",
    "leak_floor",
    "load_sensor",
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
