"""Readings of the falls of pixels, and what is known so far of the comb behind them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.sensor.calibrate.curve import Curve
from megalopta.sensor.calibrate.level import Falls


class Readings(NamedTuple):
    """How often each pixel showed each fall, (E,)."""

    level: NDArray[np.int64]
    pixel: NDArray[np.int64]
    fall: Floats
    times: Floats
    exposure: Floats
    pixels: int
    fewest: int
    """Readings of fewer events are left out of the line."""

    @classmethod
    def of(cls, falls: Falls, exposure_s: Floats) -> "Readings":
        """Of all levels, with the exposure of each."""
        return cls(
            falls.level,
            falls.pixel,
            falls.fall_v,
            falls.times,
            exposure_s[falls.level],
            falls.frames.shape[1],
            int(falls.is_cut),
        )

    def at(self, chosen: NDArray[np.bool_]) -> "Readings":
        """Some of the readings."""
        names = "level", "pixel", "fall", "times", "exposure"
        return self._replace(**{name: getattr(self, name)[chosen] for name in names})

    def sums(self, values: Floats) -> Floats:
        """Sum of values (E,) over the readings of each pixel, (P,)."""
        return np.bincount(self.pixel, self.times * values, self.pixels).astype(np.float64)


class CombState(NamedTuple):
    """What is known so far."""

    solution: Floats
    noise: Floats
    curve: Curve
    slope_error: float = np.inf
    may_slope: bool = True


def steps_of(readings: Readings, state: CombState) -> Floats:
    """Fall of each reading by events, in steps, (E,)."""
    a, leak, step = state.solution[readings.pixel].T
    return np.asarray((readings.fall - a - leak * readings.exposure) / step)


def nearest_events(readings: Readings, state: CombState) -> Floats:
    """Number of events whose tooth is nearest to each reading, (E,)."""
    step = state.solution[readings.pixel, 2]
    return np.asarray(np.rint(state.curve.numbers(steps_of(readings, state), step)).clip(0))
