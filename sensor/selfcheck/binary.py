"""Bits: their chance against the exponential; gated ones against the time open and photons."""

from collections.abc import Iterator

import numpy as np

from megalopta.sensor import changed
from megalopta.sensor.effects import DeadTime
from megalopta.sensor.readout import chance, expose_binary, unpack
from megalopta.sensor.sampling import generator
from megalopta.sensor.selfcheck.brute_force import brute_force_counts
from megalopta.sensor.selfcheck.comparison import Row, exact_row, mean_row, two_sample_z
from megalopta.sensor.selfcheck.counting import AFTERPULSING, GATE
from megalopta.sensor.spad import preset

_MEANS = np.concatenate((np.geomspace(1e-6, 0.1, 2001), np.linspace(0.1, 20, 2001)))
_RATE_HZ, _EXPOSURE_S = 1e5, 20e-6
_OPEN_S = (1 + 3 + 3 + 1) * 1e-6
"""Of 20 µs, 3 of every 7 µs open from 5 µs on: 0 to 1, 5 to 8, 12 to 15 and 19 to 20 µs."""


def check_gated_bits() -> Iterator[Row]:
    """Part of ones; dead time and afterpulses, which come after the first event, change nothing."""
    sensor = changed(
        preset("ideal"),
        exposure_s=_EXPOSURE_S,
        gate=GATE,
        afterpulsing=AFTERPULSING,
        dead_time=DeadTime(kind="paralyzable", dead_time_s=1e-6),
    )
    rate = np.full((40, 100, 100), _RATE_HZ)
    bits = unpack(expose_binary(rate, sensor, seed=5, sequence="gate"), 100).ravel()
    yield mean_row(
        "binary frames, gate",
        "part of ones",
        -np.expm1(-_RATE_HZ * _OPEN_S),
        bits.astype(np.float64),
    )
    effects = sensor.avalanche_effects
    counts = brute_force_counts(generator(5, "gate"), _RATE_HZ, _EXPOSURE_S, effects, bits.size)
    ones = np.minimum(counts, 1)
    z, _, _ = two_sample_z(ones, bits.astype(np.int64))
    yield Row("binary frames, gate", "part of ones, photon by photon", ones.mean(), bits.mean(), z)


def check_chance() -> Iterator[Row]:
    """The chance that bits are drawn by, at any light, against the exponential function."""
    found = np.array([chance.chance(mean) for mean in _MEANS.astype(np.float32)])
    off = float(np.abs(found + np.expm1(-_MEANS)).max())
    yield exact_row("binary frames", "largest error of a chance", 0.0, off, chance.CHANCE_ERROR)
