"""Light to single-photon counts: every effect of a SPAD array, on plain arrays.

    sensor = preset("spadcam")
    exposure = expose(radiance, bands_nm, sensor, seed=0, sequence="forest")
    exposure.counts, exposure.expected, exposure.saturated

Radiance is (T, H, W, B), W·m⁻²·sr⁻¹·nm⁻¹, bands_nm is (B, 2). Neither a renderer nor its files are
needed: any video in these units will do.
"""

from megalopta.sensor.afterpulsing import Afterpulsing
from megalopta.sensor.analog_counter import AnalogCounter
from megalopta.sensor.bias import Bias
from megalopta.sensor.binary import expose_binary
from megalopta.sensor.chain import ORDER_OF_EFFECTS, Effect, without
from megalopta.sensor.counter import DigitalCounter
from megalopta.sensor.counts_store import StoredCounts, read_counts, write_counts
from megalopta.sensor.crosstalk import Crosstalk
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
from megalopta.sensor.jitter import Jitter
from megalopta.sensor.measured import MapFile, MeasuredMaps
from megalopta.sensor.model import Sensor
from megalopta.sensor.optics import Lens
from megalopta.sensor.presets import PRESETS, load_sensor, preset
from megalopta.sensor.randomness import generator
from megalopta.sensor.temperature import Temperature

__all__ = [
    "ORDER_OF_EFFECTS",
    "PRESETS",
    "Afterpulsing",
    "AnalogCounter",
    "Bias",
    "Crosstalk",
    "DarkCounts",
    "DeadTime",
    "DigitalCounter",
    "Effect",
    "Efficiency",
    "Events",
    "Exposure",
    "Gate",
    "Jitter",
    "Lens",
    "MapFile",
    "MeasuredMaps",
    "Sensor",
    "StoredCounts",
    "Temperature",
    "detection_rate",
    "expected_counts",
    "expose",
    "expose_binary",
    "expose_events",
    "expose_rate",
    "generator",
    "load_sensor",
    "photon_rate",
    "preset",
    "read_counts",
    "signal_to_noise",
    "without",
    "write_counts",
]
