"""Counting and binary cameras that are known, and statistics of what they record."""

import numpy as np

from megalopta.sensor import DarkCounts, DigitalCounter, changed, expose_rate, preset
from megalopta.sensor.calibrate.counts import summed
from megalopta.sensor.spad.device import draw_fixed_pattern

SHAPE = (24, 24)
EFFICIENCY = 0.2
DARK_S, FLAT_S = (0.01, 0.05), 1e-4
LIGHTS_HZ = (1e6, 5e6, 2e7)


def camera(seed, capacity=None, dead_time_s=50e-9, kind="nonparalyzable"):
    """An array whose dark counts and efficiency scatter; capacity 1: binary."""
    counter = DigitalCounter() if capacity is None else DigitalCounter(capacity=capacity)
    dead = {"kind": kind, "dead_time_s": dead_time_s} if dead_time_s else {}
    return changed(
        preset("ideal"),
        device_seed=seed,
        pitch_m=10e-6,
        dark_counts=DarkCounts(
            bulk_mean_hz_um2=1.0,
            bulk_sigma_hz_um2=0.3,
            hot_fraction=0.02,
            hot_mean_hz_um2=100.0,
            hot_sigma_hz_um2=0.5,
        ),
        counter=counter,
        dead_time=dead,
    )


def sensitivity(seed):
    """Events per photon of every pixel."""
    return EFFICIENCY * np.random.default_rng(seed).uniform(0.8, 1.2, SHAPE)


def dark_rates(sensor):
    """Dark counts of every pixel, Hz."""
    return draw_fixed_pattern(sensor, SHAPE).dark_counts_hz


def frames_of(sensor, exposure_s, light_hz, frames, spoil=None):
    """Counts (n, rows, columns) under uniform light."""
    own = changed(sensor, exposure_s=exposure_s)
    rate = light_hz * sensitivity(sensor.device_seed)
    name = f"{sensor.device_seed} {exposure_s} {light_hz}"
    seen = np.broadcast_to(rate, (frames, *SHAPE))
    counts = expose_rate(seen, own, seed=6, stream=name).counts
    return counts if spoil is None else spoil(counts.copy())


def levels_of(sensor, frames=300, lights=LIGHTS_HZ, dark=DARK_S, flat=FLAT_S, spoil=None):
    """Dark recordings, and flat ones of several lights."""
    wanted = [*((exposure, 0.0) for exposure in dark), *((flat, light) for light in lights)]
    is_binary = sensor.counter.capacity == 1
    return [
        summed(frames_of(sensor, *each, frames, spoil), *each, is_binary=is_binary)
        for each in wanted
    ]
