"""The reading of a pixel against the arrivals that it had, and back.

The curve is that of the device model itself: dead time of either kind, afterpulses, crosstalk under
even light, gate, and the counter with its capacity and steps. Its inverse undoes all of these at
once. Under a paralyzable dead time, or a counter that wraps, a reading belongs to two brightnesses
or more; the dimmest is taken, and what may have been another is flagged.

A reading scatters by σ, so the inverse of the curve, or any function of the reading, is on average
too large by half its curvature times σ²; that is taken off, of arrivals and of their variance.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

from megalopta.core.arrays import Floats
from megalopta.sensor.change import changed
from megalopta.sensor.effects.dead_time import MOST_ARRIVALS
from megalopta.sensor.spad.measured import MeasuredMaps
from megalopta.sensor.spad.model import Sensor
from megalopta.sensor.spad.moments import reading_moments
from megalopta.sensor.spad.order import without

_NODES = 400
_DIMMEST = 1e-3
"""Arrivals in an exposure; below, the curve is straight."""
_SMALLEST_SLOPE = 0.05
"""Readings per arrival, of that in the dark: where the curve is flatter, it tells nothing."""
_BEYOND = 2.0
"""Of a curve that falls: arrivals up to so many times those at its peak are thought possible."""


@dataclass(frozen=True, eq=False)
class ResponseCurve:
    """Mean and variance of readings, over arrivals in an exposure, each (n,)."""

    arrivals: Floats
    """Photons that would be detected and dark counts, as far as readings rise with them"""
    mean: Floats
    variance: Floats
    ambiguous_from: float
    """Readings from here on may stand for more than the last arrivals; infinite where none can"""

    @property
    def largest(self) -> float:
        """The largest reading that tells the arrivals."""
        return float(self.mean[-1])

    def arrivals_of(self, readings: Floats) -> tuple[Floats, Floats]:
        """Return arrivals and their variance, from readings of any shape.

        Readings below that in the dark give negative arrivals, so that means are right; those above
        `largest` give the last arrivals of the curve.
        """
        inverse = PchipInterpolator(self.mean, self.arrivals)
        bent = np.clip(readings, self.mean[0], self.mean[-1])
        spread = np.gradient(self.arrivals, self.mean) ** 2 * self.variance
        arrivals = inverse(bent) - self._excess(self.arrivals, bent)
        arrivals += np.minimum(readings - self.mean[0], 0) * inverse(self.mean[0], 1)
        variance = np.interp(bent, self.mean, spread) - self._excess(spread, bent)
        return np.asarray(arrivals), np.maximum(variance, 0)

    def _excess(self, values: Floats, readings: Floats) -> Floats:
        """By how much the mean over the noise of a function of the reading is too large."""
        slopes = np.gradient(values, self.mean)
        excess = 0.5 * np.gradient(slopes, self.mean) * self.variance
        return np.asarray(np.interp(readings, self.mean, excess))


def response_curve(sensor: Sensor) -> ResponseCurve:
    """Return the curve of a pixel that is like the mean of its array, without dark counts.

    Raises ValueError when no reading tells the arrivals.
    """
    plain = _without_pattern(sensor)
    # neighbors matter under crosstalk only
    side = 9 if plain.crosstalk.is_on else 1
    arrivals = np.concatenate(([0.0], np.geomspace(_DIMMEST, _most_arrivals(plain), _NODES)))
    rates = np.broadcast_to(arrivals[:, None, None] / plain.exposure_s, (arrivals.size, side, side))
    mean, variance = (each[:, side // 2, side // 2] for each in reading_moments(rates, plain))
    slopes = np.diff(mean) / np.diff(arrivals)
    flat = np.flatnonzero(slopes < _SMALLEST_SLOPE * slopes[:10].max())
    end = int(flat[0]) if flat.size else arrivals.size - 1
    if end < 2:
        raise ValueError(
            f"sensor {sensor.name!r}: its readings do not rise with the light; nothing can be "
            "corrected"
        )
    rising = slice(0, end + 1)
    return ResponseCurve(
        arrivals[rising],
        mean[rising],
        variance[rising],
        _ambiguous_from(arrivals, mean, variance, plain),
    )


def _without_pattern(sensor: Sensor) -> Sensor:
    """The sensor with pixels that do not differ, neither as drawn nor as measured."""
    alike: dict[str, Any] = {
        part: {name: 0.0 for name in type(getattr(sensor, part)).model_fields if "sigma" in name}
        for part in ("counter", "dead_time", "afterpulsing", "crosstalk")
    }
    plain = sensor.model_copy(update={"measured": MeasuredMaps()})
    return changed(without(plain, "dark_counts"), **alike)


def _most_arrivals(sensor: Sensor) -> float:
    """Arrivals beyond which readings rise no more: of the counter, or of the dead time."""
    most = 4.0 * sensor.counter.capacity
    if sensor.dead_time.kind != "ideal" and sensor.dead_time.dead_time_s:
        most = min(most, 20 * sensor.exposure_s / sensor.dead_time.dead_time_s)
    return min(most, MOST_ARRIVALS / 2)


def _ambiguous_from(arrivals: Floats, mean: Floats, variance: Floats, sensor: Sensor) -> float:
    wraps = getattr(sensor.counter, "overflow", "saturate") == "wrap"
    if sensor.dead_time.kind != "paralyzable" and not wraps:
        return np.inf
    peak = int(np.argmax(mean))
    possible = arrivals <= _BEYOND * arrivals[peak]
    after = (np.arange(arrivals.size) > peak) & possible
    if not after.any():
        return np.inf
    return float(np.min(mean[after] - 3 * np.sqrt(variance[after])))
