"""Recordings of a known device, as counts."""

import numpy as np

from megalopta.sensor import Crosstalk, DeadTime, DigitalCounter, changed, expose_rate, preset
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.compare.model import Model
from megalopta.sensor.compare.recordings import compare_recordings
from megalopta.sensor.spad.device import draw_fixed_pattern

SHAPE = (16, 16)
LEVELS = ((0.02, 0.0), (2e-4, 2e7), (2e-4, 7e8))
"""Exposure s and photons per second on a pixel"""
EFFICIENCY = 1.1e-3


def camera(dead_time_s=1e-6, crosstalk=0.0):
    """SPADCAM; with crosstalk, events of dead time are simulated one by one."""
    sensor = changed(
        preset("spadcam"),
        device_seed=3,
        counter=DigitalCounter(),
        dead_time=DeadTime(kind="paralyzable", dead_time_s=dead_time_s),
    )
    if crosstalk:
        return changed(
            sensor, dead_time=DeadTime(), crosstalk=Crosstalk(mean_fired_neighbors=crosstalk)
        )
    return sensor


def recorded(seed, sensor=None, frames=400, dark=1.0, efficiency=1.0, step=1.0, levels=LEVELS):
    """Levels of a camera some of whose quantities are so many times as large."""
    sensor = sensor or camera()
    found = []
    for exposure_s, light_hz in levels:
        own = changed(sensor, exposure_s=exposure_s)
        pattern = draw_fixed_pattern(own, SHAPE)
        more = (dark - 1) * pattern.dark_counts_hz
        rate = light_hz * EFFICIENCY * efficiency * pattern.efficiency_factor + more
        rates = np.broadcast_to(rate, (frames, *SHAPE))
        name = f"{exposure_s} {light_hz}"
        counts = expose_rate(rates, own, seed=seed, sequence=name).counts
        found.append(Level(np.rint(counts * step), exposure_s, light_hz))
    return found


def against(captured, expected, sensor=None, **options):
    """Comparison with a recording of a camera that is known."""
    sensor = sensor or camera()
    rates = [
        (level.light_hz * EFFICIENCY * draw_fixed_pattern(sensor, SHAPE).efficiency_factor)[None]
        for level in expected
    ]
    return compare_recordings(captured, expected, Model(sensor, rates), **options)
