"""Light to single-photon counts: optics, detection, dark counts and dead time, on plain arrays.

    sensor = preset("spadcam")
    exposure = expose(radiance, bands_nm, sensor, seed=0, sequence="forest")
    exposure.counts, exposure.expected, exposure.saturated

Radiance is (T, H, W, B), W·m⁻²·sr⁻¹·nm⁻¹, bands_nm is (B, 2). Neither a renderer nor its files are
needed: any video in these units will do.
"""

from megalopta.sensor.counts_store import StoredCounts, read_counts, write_counts
from megalopta.sensor.dark_counts import DarkCounts
from megalopta.sensor.dead_time import DeadTime
from megalopta.sensor.efficiency import Efficiency
from megalopta.sensor.exposure import (
    Exposure,
    detection_rate,
    expected_counts,
    expose,
    expose_rate,
    photon_rate,
    signal_to_noise,
)
from megalopta.sensor.model import Sensor
from megalopta.sensor.optics import Lens
from megalopta.sensor.presets import PRESETS, preset
from megalopta.sensor.randomness import generator

__all__ = [
    "PRESETS",
    "DarkCounts",
    "DeadTime",
    "Efficiency",
    "Exposure",
    "Lens",
    "Sensor",
    "StoredCounts",
    "detection_rate",
    "expected_counts",
    "expose",
    "expose_rate",
    "generator",
    "photon_rate",
    "preset",
    "read_counts",
    "signal_to_noise",
    "write_counts",
]
